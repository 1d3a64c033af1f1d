"""If this fails, a scene's log forks, or loses what was decided, while those who decide it come, go, die and lose their disks."""

from __future__ import annotations

import random
from collections.abc import Sequence

import pytest
import trio

from scenefold.base.errors import Refused
from scenefold.store.layout import LOGS
from scenefold.store.log_rows import position_of, unpack_decided
from scenefold.wire import AcceptSceneProposal, LogEntry, RemoveParticipant
from simulation.assembly import Assembly, assembled

NODES = 5
STEPS = 25


class Storm:
    """At most one node is down, or cut off, at a time: so whoever decides can go on."""

    def __init__(self, them: Assembly, seed: int) -> None:
        self.them, self.dice = them, random.Random(seed)
        self.acknowledged: set[bytes] = set()
        self.down: int | None = None
        self.done: dict[str, int] = {}

    def count(self, what: str) -> None:
        self.done[what] = self.done.get(what, 0) + 1

    async def offer(self, slot: int, entry: LogEntry) -> None:
        """An owner who gives up after a while, and believes nothing but a 119."""
        them = self.them
        with trio.move_on_after(9.0):
            try:
                offered = them.following(await them.read(slot), entry)
                reply = await them.offer(slot, offered)
            except (Refused, AssertionError):
                # It does not fit any more, or this node has no log, or runs no more.
                return
            if isinstance(reply, AcceptSceneProposal):
                self.acknowledged.add(offered.header.request)
                self.count("decided")

    def anybody(self) -> int:
        return self.dice.choice([slot for slot in range(NODES) if slot != self.down])

    async def step(self, calls: trio.Nursery) -> None:
        them, dice = self.them, self.dice
        what = dice.choices(("change", "join", "leave", "crash", "wipe", "cut"), (8, 3, 3, 2, 1, 2))[0]
        slot = self.anybody()
        header = them.of(slot).scenes.here(them.scene)
        if header is None:
            # It has begun anew a moment ago.
            return
        deciding = {entry.member for entry in header.public.participants}
        if what == "change":
            calls.start_soon(self.offer, slot, them.grant())
        elif what == "join":
            new = [other for other in range(NODES) if other != self.down and them.entry(other).member not in deciding]
            nodes = {member.node for member in deciding}
            new = [other for other in new if them.node(other).node_id not in nodes]
            if new:
                calls.start_soon(self.offer, slot, them.added(dice.choice(new)))
        elif what == "leave" and len(deciding) > 3:
            lost = [member for member in deciding if member not in {them.entry(o).member for o in range(NODES) if o != self.down}]
            leaving = dice.choice(sorted(lost or deciding, key=lambda member: member.node))
            calls.start_soon(self.offer, slot, RemoveParticipant(leaving))
        elif what in ("crash", "wipe") and self.down is None:
            self.down = slot
            them.crash(slot)
            # Whose disk is lost counts as a member who failed for good: so there is one at most.
            if what == "wipe" and slot != 0 and not self.done.get("wipe"):
                await them.node(slot).gone.wait()
                them.cluster.wipe(them.node(slot), "storm")
                self.count("wipe")
            calls.start_soon(self.come_back, slot, dice.uniform(1.0, 6.0))
        elif what == "cut" and self.down is None:
            self.down = slot
            addresses = [them.node(other).address for other in range(NODES)]
            crack = them.cluster.net.partition([addresses[slot]], [address for address in addresses if address != addresses[slot]])
            calls.start_soon(self.mend, crack, dice.uniform(1.0, 6.0))
        self.count(what)

    async def come_back(self, slot: int, after_s: float) -> None:
        await trio.sleep(after_s)
        await self.them.start(slot)
        self.down = None

    async def mend(self, crack: object, after_s: float) -> None:
        await trio.sleep(after_s)
        self.them.cluster.net.unite(crack)  # type: ignore[arg-type]
        await trio.sleep(1.0)
        self.down = None


def decided_everywhere(them: Assembly) -> dict[int, set[bytes]]:
    """What lies on the disks, by position."""
    found: dict[int, set[bytes]] = {}
    for slot in range(NODES):
        for key, row in them.node(slot).disk.peek(LOGS).items():
            position = position_of(key)
            if position:
                found.setdefault(position, set()).add(unpack_decided(key, memoryview(row)).value.digest)
    return found


@pytest.mark.parametrize("seed", range(3))
def test_one_history_whoever_decides(seed: int) -> None:
    check(seed, (1.0,) * NODES)


@pytest.mark.parametrize("seed", range(3, 5))
def test_31_one_history_however_wrong_the_clocks_go(seed: int) -> None:
    """By a fifth, where leases count on a hundredth: who may act in which mode hangs on that, and what is decided does not."""
    check(seed, (0.8, 1.2, 1.0, 1.2, 0.8))


def check(seed: int, rates: Sequence[float]) -> None:
    """`rates`: of each node's clock."""

    async def main(them: Assembly) -> None:
        for slot, rate in enumerate(rates):
            them.cluster.net.machine(them.node(slot).address).clock.set_rate(rate)
        await them.create(0, 1, 2)
        storm = Storm(them, seed)
        async with trio.open_nursery() as calls:
            for _ in range(STEPS):
                await storm.step(calls)
                await trio.sleep(storm.dice.uniform(0.0, 2.0))
        await trio.sleep(15.0)
        keeper = next(slot for slot in range(NODES) if them.takes_part(slot))
        position = await them.commits(keeper)
        for slot in range(NODES):
            # Who was away when others were told asks as soon as somebody needs it.
            await them.of(slot).scenes.known(them.scene, position=position)
        await them.everybody_at(position, *range(NODES))
        assert all(len(digests) == 1 for digests in decided_everywhere(them).values()), storm.done
        requests = (await them.read(keeper)).log.state.requests
        assert storm.acknowledged <= set(requests), storm.done
        assert len({them.of(slot).scenes.here(them.scene).public.signable() for slot in range(NODES)}) == 1  # type: ignore[union-attr]
        assert storm.done.get("decided", 0) >= 5, storm.done

    assembled(NODES, main, seed)
