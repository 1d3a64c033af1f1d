"""If one fails, a node that compares, pays and heals takes more of the link than it was given for moving data, or much less."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import accumulate
from typing import Any

import pytest
import trio

from scenefold.base.ids import NodeId
from scenefold.base.location import Location
from scenefold.crypto import Record
from scenefold.peer.line.budget import BURST_S
from scenefold.store import Put
from scenefold.wire import HandItem, HeldFetched, Packet, PutMany, StoreCopies
from scenefold.world import Priority
from unit.peer.line.street import places, rot
from unit.peer.replication.terrace import Home, Terrace, record_at
from unit.peer.replication.test_comparing import arc_of, holders_of, is_settled, played
from unit.peer.replication.test_placing import until
from unit.peer.replication.writers import offered

RATE = 128 * 1024
PAYLOAD = b"x" * 20_000
LACKING, OWED, ALONE, ROTTEN = 30, 20, 8, 12
"""Records that a holder was never sent; that it is owed; that only it has; and that have rotted where it is the owner who is asked."""
LAST_BYTE = -1


def large(location: Location) -> Record:
    return record_at(location, payload=PAYLOAD)


@dataclass
class Moved:
    """When how many bytes of records one house sent to holders, and got from others."""

    sent: list[tuple[float, int]] = field(default_factory=list)
    got: list[tuple[float, int]] = field(default_factory=list)


def watch(home: Home, begin: float, spread: Iterable[Location], monkeypatch: pytest.MonkeyPatch) -> Moved:
    """What it moves from now on. `spread`: what is new to the house goes to its other holders as writes do, which no budget holds up."""
    moved, ask, left_out = Moved(), home.peers.ask, frozenset(spread)

    def note(where: list[tuple[float, int]], items: Iterable[HandItem]) -> None:
        if size := sum(len(item.ciphertext) for item in items):
            where.append((trio.current_time() - begin, size))

    async def watched(member: NodeId, priority: Priority, packet: Packet, answer: type[Any], timeout: float) -> Any:
        if isinstance(packet, StoreCopies):
            note(moved.sent, [item for item in packet.items if item.location not in left_out])
        reply = await ask(member, priority, packet, answer, timeout)
        if isinstance(reply, HeldFetched):
            note(moved.got, reply.items)
        return reply

    monkeypatch.setattr(home.peers, "ask", watched)
    return moved


@pytest.mark.expect_log("damaged|rotten|changed")
def test_comparing_paying_and_healing_together_keep_to_the_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first, second = terrace.homes[:2]
        await until(lambda: all(map(is_settled, terrace.homes)))
        events = first.living.parts.events
        # What is another's is healed without a word to its other holders.
        rotten = [place for place in places(arc_of(second), 4 * ROTTEN) if first in holders_of(terrace, second, place)][:ROTTEN]
        await second.store.put([Put(large(place)) for place in rotten])
        second.replication.comparing.check_all()
        await until(lambda: first.places() >= set(rotten))
        spots = places(arc_of(first), 4 * (LACKING + OWED + ALONE))
        both = holders_of(terrace, first, spots[0])
        away = next(home for home in both if home is not second)
        spots = [place for place in spots if holders_of(terrace, first, place) == both][: LACKING + OWED + ALONE]
        lacking, owed, alone = spots[:LACKING], spots[LACKING:-ALONE], spots[-ALONE:]
        assert (len(rotten), len(lacking), len(owed), len(alone)) == (ROTTEN, LACKING, OWED, ALONE)

        terrace.net.cut(first.address, away.address)
        outcomes = (await first.asked(PutMany(tuple(offered(large(place)) for place in owed)))).outcomes
        assert {outcome.reason for outcome in outcomes} == {0}
        await until(lambda: not first.roster.is_believed_alive(away.node))
        assert first.store.owed == {away.node: OWED}
        await first.store.put([Put(large(place)) for place in lacking])
        await away.store.merge([Put(large(place)) for place in alone])
        events.clear()
        first.living.parts.budget.bytes_per_s = RATE
        begin = trio.current_time()
        moved = watch(first, begin, alone, monkeypatch)
        terrace.net.mend(first.address, away.address)
        first.replication.comparing.check_all()
        rot(first, rotten, LAST_BYTE)
        await first.store.read([first.spot(place) for place in rotten])
        await until(lambda: events["healed"] == ROTTEN and away.places() >= set(spots) and not first.store.owed)

        assert events["copies sent"] >= LACKING and events["debts paid"] >= OWED // 4 and events["copies fetched"] == ALONE
        got = sum(count for _, count in moved.got)
        assert got >= (ROTTEN + ALONE) * len(PAYLOAD)
        for (at, _), total in zip(moved.sent, accumulate(count for _, count in moved.sent), strict=True):
            assert total <= RATE * (at + BURST_S), f"too much within {at:.2f} s"
        # What comes from others is taken on credit: who sends later waits that off, too.
        whole, last_at = got + sum(count for _, count in moved.sent), moved.sent[-1][0]
        assert whole <= RATE * (last_at + BURST_S), f"{whole} bytes within {last_at:.2f} s"
        assert last_at <= 2 * whole / RATE, "most of the rate is used"

    played(main, seed=4)
