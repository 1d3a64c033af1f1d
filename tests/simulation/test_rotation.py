"""If this fails, a scene whose key changes while people work in it, and a node dies, cannot be read, or loses what was written."""

from __future__ import annotations

import datetime
from collections.abc import Iterator
from contextlib import AsyncExitStack, ExitStack, contextmanager
from dataclasses import dataclass, field

import pytest
import trio

from scenefold.base.errors import Refused, Unreachable
from scenefold.base.location import Location
from scenefold.base.reasons import RejectReason
from scenefold.client.progress import ProgressState
from scenefold.client.scene import Scene
from scenefold.crypto import Card, RecordHeader, SigningKey
from scenefold.scene.layout import META, RENDERS
from scenefold.simulation.clients import MemoryKeyring, open_client, secrets_of
from scenefold.simulation.cluster import Cluster, key_of
from scenefold.simulation.final import judge_histories
from scenefold.simulation.removals import watch_removals
from scenefold.simulation.speed import remembered_signatures
from scenefold.wire import Role
from scenefold.world.sim import Point, SimNet, run_simulated
from simulation.steps import SETTLES_S, Stage

RECORDS = 40
RESTART_S = 3.0
SLOWLY = 100.0
"""Bytes a second: a walk takes some eight seconds."""


def card_of(name: str, key: SigningKey) -> Card:
    """A card as a verified certificate gives it."""
    day = datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC)
    return Card(name, (), secrets_of(key).public(), 1, day, day, b"")


@dataclass
class Work:
    """What people do meanwhile: Ada overwrites every other record, Ben reads all of them."""

    places: list[Location]
    ada: Scene
    ben: Scene
    newest: dict[Location, int] = field(default_factory=dict)
    tried: dict[Location, int] = field(default_factory=dict)
    may_fail: bool = False
    """Whether a node dies: what it alone holds can be neither read nor written until it is back."""
    reads: int = 0
    done: bool = False

    @contextmanager
    def hardship(self) -> Iterator[None]:
        try:
            yield
        except Unreachable:
            assert self.may_fail
        except Refused as refusal:
            if not self.may_fail or refusal.reason not in (RejectReason.NOT_READY, RejectReason.BUSY):
                raise

    async def write(self) -> None:
        number = 0
        while not self.done:
            number += 1
            for place in self.places[::2]:
                self.tried[place] = number
                with self.hardship():
                    await self.ada.space(META).put(place, b"%d" % number)
                    self.newest[place] = number
                await trio.sleep(0.05)

    async def read(self) -> None:
        while not self.done:
            with self.hardship():
                await self._read()
            await trio.sleep(0.05)

    async def _read(self) -> None:
        least = dict(self.newest)
        found = await self.ben.space(META).get_many(self.places)
        for place, payload in zip(self.places, found, strict=True):
            assert payload is not None
            assert least.get(place, 0) <= int(payload) <= self.tried.get(place, 0)
        self.reads += 1


class Play:
    def __init__(self, seed: int, slot: int, count: int = 0) -> None:
        self.seed, self.slot, self.count = seed, slot, count
        self.net = SimNet(seed)

    def run(self) -> None:
        with ExitStack() as stack:
            stack.enter_context(remembered_signatures())
            run_simulated(self.seed, self._play, virtual_s_max=2_000.0, steps_max=4_000_000)

    async def _play(self) -> None:
        async with trio.open_nursery() as nursery, AsyncExitStack() as stack:
            self.cluster = cluster = Cluster(self.net, 3, 1, nursery)
            for slot in range(3):
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
            places = [Location.from_number((1 << 160) * (2 * index + 1) // (2 * RECORDS)) for index in range(RECORDS)]
            await scene.space(META).put_many((place, b"0") for place in places)
            objects = [await scene.space(RENDERS).put_managed(b"thing %d" % index) for index in range(6)]
            await trio.sleep(SETTLES_S)
            work = Work(places, *[await clients[name].scenes.open("kitchen") for name in ("ada", "ben")])
            work.may_fail = self.count > 0
            async with trio.open_nursery() as people:
                people.start_soon(work.write)
                people.start_soon(work.read)
                await trio.sleep(1.0)
                await self._rotate(scene, nursery)
                work.done = True
            assert work.reads > 3
            await self._check(clients["owner"].scenes.open("kitchen"), work, objects)  # type: ignore[arg-type]
            nursery.cancel_scope.cancel()

    async def _rotate(self, scene: Scene, nursery: trio.Nursery) -> None:
        """A new key, two walks that are ended in their midst, and one that is not; a node dies at its n-th commit."""

        def die() -> None:
            if self.cluster.crash(self.slot):
                nursery.start_soon(self.cluster.restart, self.slot, RESTART_S)

        if self.count:
            self.net.trap(self.cluster.nodes[self.slot].address, Point.AFTER_COMMIT, self.count, die)
        for end in ("rotate", "walk", "walk", "finish"):
            with trio.CancelScope() as scope:

                def stop(state: ProgressState, end: str = end, scope: trio.CancelScope = scope) -> None:
                    if end == "walk" and state.done:
                        scope.cancel()

                try:
                    if end == "rotate":
                        await scene.rotate_key()
                    else:
                        await scene.reencrypt(stop, SLOWLY)
                except Unreachable:
                    assert self.count
                    # The keeper of the log was away: nobody knows, so one looks.
                    await trio.sleep(2 * RESTART_S)
                    if end == "finish":
                        await scene.reencrypt()

    async def _check(self, opening: object, work: Work, objects: list[object]) -> None:
        scene: Scene = await opening  # type: ignore[misc]
        await self.stage.until(self.stage.is_quiet)
        found = await scene.space(META).get_many(work.places)
        for place, payload in zip(work.places, found, strict=True):
            assert payload is not None
            assert work.newest.get(place, 0) <= int(payload) <= work.tried.get(place, 0)
        assert await scene.space(RENDERS).managed.get(objects) == [b"thing %d" % index for index in range(6)]  # type: ignore[arg-type]
        epoch = (await scene.members()).key_epoch
        assert epoch == 1
        records = await scene.access.fetch([(META, place) for place in work.places])
        assert {RecordHeader.decode(record.header).key_epoch for record in records if record is not None} == {epoch}
        report = await scene.reencrypt()
        assert (report.renewed, report.unreadable, report.walks) == (0, 0, 1)
        judge_histories(self.cluster.watch)
        assert not self.cluster.watch.violations, self.stage.told(str(self.cluster.watch.violations[0]))


def test_a_rotation_alone_is_met_by_nobody() -> None:
    Play(8, 0).run()


CRASHES = [(seed, slot, count) for seed, (slot, count) in enumerate([(0, 1), (0, 2), (0, 9), (1, 1), (1, 8), (2, 3), (2, 20)], 1)]


@pytest.mark.expect_log("connection was cut|no connection to the node|no lease from the voter|does not answer")
@pytest.mark.parametrize(("seed", "slot", "count"), CRASHES)
def test_a_rotation_disturbs_nobody(seed: int, slot: int, count: int) -> None:
    Play(seed, slot, count).run()
