"""A scene in which an owner, a writer and a reader work on three simulated nodes, while the owner does what a test is about and a node dies."""

from __future__ import annotations

import datetime
from abc import ABC, abstractmethod
from contextlib import AsyncExitStack, ExitStack

import trio

from scenefold.base.location import LINE_LENGTH, Location
from scenefold.client.scene import Scene
from scenefold.crypto import Card, SigningKey
from scenefold.simulation.clients import MemoryKeyring, open_client, secrets_of
from scenefold.simulation.cluster import Cluster, key_of
from scenefold.simulation.final import judge_histories
from scenefold.simulation.removals import watch_removals
from scenefold.simulation.speed import remembered_signatures
from scenefold.wire import Role
from scenefold.world.sim import Point, SimNet, run_simulated
from simulation.steps import SETTLES_S, Stage

NODES = 3
RESTART_S = 3.0


def card_of(name: str, key: SigningKey) -> Card:
    """A card as a verified certificate gives it."""
    day = datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC)
    return Card(name, (), secrets_of(key).public(), 1, day, day, b"")


def places_evenly(count: int) -> list[Location]:
    return [Location.from_number(LINE_LENGTH * (2 * index + 1) // (2 * count)) for index in range(count)]


class KitchenPlay(ABC):
    """One run: `count` is the commit at which the node of `slot` dies once it is trapped, 0 for none."""

    cluster: Cluster
    stage: Stage

    def __init__(self, seed: int, slot: int, count: int = 0) -> None:
        self.seed, self.slot, self.count = seed, slot, count
        self.net = SimNet(seed)
        self.died = False

    def run(self) -> None:
        with ExitStack() as stack:
            stack.enter_context(remembered_signatures())
            run_simulated(self.seed, self._run, virtual_s_max=2_000.0, steps_max=4_000_000)

    @abstractmethod
    async def play(self, scene: Scene, ada: Scene, ben: Scene, nursery: trio.Nursery) -> None:
        """What happens: the same scene as its owner, a writer and a reader have it opened."""

    def trap(self, nursery: trio.Nursery) -> None:
        """From now on the node dies at its n-th commit, and comes back."""

        def die() -> None:
            if self.cluster.crash(self.slot):
                self.died = True
                nursery.start_soon(self.cluster.restart, self.slot, RESTART_S)

        if self.count:
            self.net.trap(self.cluster.nodes[self.slot].address, Point.AFTER_COMMIT, self.count, die)

    def judge(self) -> None:
        """By the laws of every storm."""
        judge_histories(self.cluster.watch)
        assert not self.cluster.watch.violations, self.stage.told(str(self.cluster.watch.violations[0]))

    async def _run(self) -> None:
        async with trio.open_nursery() as nursery, AsyncExitStack() as stack:
            self.cluster = cluster = Cluster(self.net, NODES, 1, nursery)
            for slot in range(NODES):
                cluster.start(slot)
            nursery.start_soon(watch_removals, cluster)
            clients = {}
            for name in ("owner", "ada", "ben"):
                key = key_of(self.seed, name)
                opening = open_client(
                    name, self.net.world(f"user:{name}"), cluster.facts, MemoryKeyring(), key, cluster.watch.recorder, f"user:{name}"
                )
                clients[name] = await stack.enter_async_context(opening)
            self.stage = Stage(cluster, clients["owner"], nursery, None)
            await self.stage.until(self.stage.is_quiet, 30.0)
            scene = await clients["owner"].scenes.create("kitchen", copies=1)
            for name, role in (("ada", Role.WRITER), ("ben", Role.READER)):
                await scene.grant(card_of(f"user:{name}", key_of(self.seed, name)), role)
            await trio.sleep(SETTLES_S)
            await self.play(scene, *[await clients[name].scenes.open("kitchen") for name in ("ada", "ben")], nursery)
            nursery.cancel_scope.cancel()
