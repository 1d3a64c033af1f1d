"""Whole nodes that crash at the n-th commit or packet of a join, a drain or a transfer (test_every_step).

Each run is a small cluster in the simulated world, with the observer of the simulation looking on: a story (somebody joins,
somebody leaves, a piece passes) is played with one crash in it, then every node is restarted once, and at the end the
line must be tiled, nothing open, no stray anywhere, and every acknowledged record readable in its newest version.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from contextlib import ExitStack
from dataclasses import dataclass, field

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.location import Arc, Location
from scenefold.peer.line import Side
from scenefold.scene.layout import META
from scenefold.simulation.calm import unrest
from scenefold.simulation.clients import Client, MemoryKeyring, open_client
from scenefold.simulation.cluster import Cluster, key_of
from scenefold.simulation.final import judge_histories, read_everything
from scenefold.simulation.leaving import drain
from scenefold.simulation.removals import watch_removals
from scenefold.simulation.speed import remembered_signatures
from scenefold.world.sim import Point, SimNet, run_simulated

RECORDS = 10
SETTLES_S = 11.0
QUIET_S_MAX = 200.0
RESTART_S = 1.0


class Disturbed(Exception):
    """What did not hold at the end, with the last lines of the story."""


@dataclass(frozen=True, slots=True)
class Crash:
    """Of a node at its n-th passing of a point. `returns`: it is started again a second later; else only once it was removed."""

    slot: int
    point: Point
    count: int
    returns: bool = True


@dataclass
class Stage:
    """A cluster, a client, and what happened."""

    cluster: Cluster
    client: Client
    nursery: trio.Nursery
    crash: Crash | None
    sprung: bool = False
    absent: set[int] = field(default_factory=set)

    def arm(self) -> None:
        """From now on steps are counted."""
        if self.crash is not None:
            node = self.cluster.nodes[self.crash.slot]
            self.cluster.net.trap(node.address, self.crash.point, self.crash.count, self._spring)

    def disarm(self) -> None:
        for node in self.cluster.nodes.values():
            if node.born.is_set():
                self.cluster.net.machine(node.address).traps.clear()

    def _spring(self) -> None:
        assert self.crash is not None
        self.sprung = True
        if self.cluster.crash(self.crash.slot):
            if self.crash.returns:
                self.nursery.start_soon(self.cluster.restart, self.crash.slot, RESTART_S)
            else:
                self.absent.add(self.crash.slot)

    def is_quiet(self) -> bool:
        """All that may be wrong is what lies on the disk of one that is away, and no member any more: records, and its arc."""
        if any(self.registered(slot) for slot in self.absent):
            return False
        found = unrest(self.cluster)
        if self.absent:
            found = [wrong for wrong in found if not (wrong.slots and set(wrong.slots) <= self.absent) and "table" not in wrong.what]
        return not found

    async def until(self, holds: Callable[[], bool], seconds: float = QUIET_S_MAX) -> None:
        with trio.move_on_after(seconds):
            while not holds():  # noqa: ASYNC110 - the disks are the truth, and tell nobody when they change
                await trio.sleep(0.5)
            return
        raise Disturbed(self.told(f"never came to rest: {unrest(self.cluster)}"))

    def told(self, what: str) -> str:
        lines = [str(line) for line in self.cluster.watch.story.lines]
        return "\n".join([f"{self.crash}: {what}", *lines[-60:]])

    def check(self, holds: bool, what: str) -> None:
        if not holds:
            raise Disturbed(self.told(what))

    def registered(self, slot: int) -> bool:
        voter = self.cluster.voter.context
        return voter is not None and voter.cluster_log.registry.stands(self.cluster.nodes[slot].node_id)

    def owns(self, slot: int) -> Arc | None:
        context = self.cluster.nodes[slot].context
        return None if context is None else context.line.arc


Story = Callable[[Stage], Awaitable[None]]


async def joining(stage: Stage) -> None:
    """The third node joins left of the second, which is the fullest."""
    stage.cluster.start(2)
    await stage.cluster.nodes[2].born.wait()
    stage.arm()
    await stage.until(lambda: 2 in stage.absent or (stage.owns(2) is not None and stage.is_quiet()))


async def leaving(stage: Stage) -> None:
    """The second of three nodes hands everything over and leaves."""
    node = stage.cluster.nodes[1]
    stage.arm()
    # An order that was not answered may have been heard, and may have been forgotten.
    for _ in range(30):
        if 1 in stage.absent or await drain(stage.client, node):
            break
        await trio.sleep(RESTART_S)
    await stage.until(lambda: 1 in stage.absent or not stage.registered(1))
    await stage.until(lambda: 1 in stage.absent or stage.is_quiet())


async def handing(stage: Stage) -> None:
    """The second node gives half of its arc to the first."""
    before = stage.owns(1)
    stage.arm()
    for _ in range(30):
        arc, context = stage.owns(1), stage.cluster.nodes[1].context
        if stage.absent:
            return
        if arc is not None and arc != before:
            await stage.until(stage.is_quiet)
            return
        if arc is not None and context is not None:
            piece = Arc(arc.first, Location.from_number(arc.first.number + arc.length // 2))
            try:
                with trio.move_on_after(30.0):
                    await context.line.give(Side.LEFT, piece, why="a test")
            except (Refused, Unreachable, PeerFault):
                pass
        await trio.sleep(RESTART_S)
    raise Disturbed(stage.told("the piece did not pass"))


def play(story: Story, crash: Crash | None = None, *, founders: int = 2, seed: int = 1) -> bool:
    """Whether the story came as far as the crash. Disturbed if anything is wrong afterwards."""
    with ExitStack() as stack:
        stack.enter_context(remembered_signatures())
        return run_simulated(seed, _play, story, crash, founders, seed, virtual_s_max=2_000.0, steps_max=2_000_000)


async def _play(story: Story, crash: Crash | None, founders: int, seed: int) -> bool:
    net = SimNet(seed)
    async with trio.open_nursery() as nursery:
        cluster = Cluster(net, founders, 1, nursery)
        for slot in range(founders):
            cluster.start(slot)
        nursery.start_soon(watch_removals, cluster)
        opening = open_client("c", net.world("user:c"), cluster.facts, MemoryKeyring(), key_of(seed, "the writer"), cluster.watch.recorder)
        async with opening as client:
            stage = Stage(cluster, client, nursery, crash)
            await stage.until(stage.is_quiet, 30.0)
            client.scene = await client.scenes.open_or_create("steps", copies=1)
            arc = stage.owns(1)
            assert arc is not None
            places = [Location.from_number(arc.first.number + arc.length * index // RECORDS) for index in range(RECORDS)]
            for place in places:
                await client.scene.space(META).put(place, b"x" * 200)
            await trio.sleep(SETTLES_S)
            await story(stage)
            stage.disarm()
            await _return_absent(stage)
            await stage.until(stage.is_quiet)
            await _restart_all(stage)
            await stage.until(stage.is_quiet)
            cluster.watch.homecoming.judge_rest()
            await read_everything(cluster.watch, client)
            judge_histories(cluster.watch)
            if cluster.watch.violations:
                raise Disturbed(stage.told(str(cluster.watch.violations[0])))
        nursery.cancel_scope.cancel()
    return stage.sprung


async def _return_absent(stage: Stage) -> None:
    """Who did not return is removed, and comes back only then: what it alone holds are strays by then."""
    await stage.until(stage.is_quiet)
    for slot in sorted(stage.absent):
        stage.absent.remove(slot)
        await stage.cluster.restart(slot, RESTART_S)


async def _restart_all(stage: Stage) -> None:
    """What is only in memory must not be what holds things together."""
    for slot, node in stage.cluster.nodes.items():
        if stage.cluster.crash(slot):
            await node.gone.wait()
            stage.cluster.start(slot)


def crashes(story: Story, slot: int, point: Point, *, founders: int = 2, returns: bool = True, stride: int = 1) -> int:
    """Play the story with a crash at the first, second, ... passing (each `stride`-th), until it ends before that."""
    count = 1
    while play(story, Crash(slot, point, count, returns), founders=founders):
        count += stride
    return count - 1
