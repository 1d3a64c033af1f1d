"""If one fails, a full disk keeps others from being made holders, or all copies leave it at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any, cast

import pytest
import trio

from scenefold.base.ids import NodeId
from scenefold.base.location import Arc, Location
from scenefold.base.prefixes import ADDRESS_BITS, AddressPrefix, Blacklist
from scenefold.peer.copies.configurations import Configurations
from scenefold.peer.copies.segment import Segment
from scenefold.peer.replication.full_holders import AGAIN_S_MAX, AGAIN_S_MIN, FORGOTTEN_S, FullHolders, around_full
from scenefold.peer.replication.placing_wishes import Piece
from scenefold.store import Outcome, Put, PutResult
from scenefold.wire import Configuration, Member
from unit.peer.replication.terrace import THIRDS, Terrace
from unit.peer.replication.test_comparing import holders_of, is_settled, lies_with_all, played
from unit.peer.replication.test_healing import filled
from unit.peer.replication.test_placing import until

P, A, B, C = (Member(NodeId(node), bytes([node]) * 16) for node in range(1, 5))
ALLOWED = {member.node: member for member in (A, B, C)}


def arc(first: int, last: int) -> Arc:
    return Arc(Location.from_number(first), Location.from_number(last))


def first_two(piece: Arc, allowed: Mapping[NodeId, Member]) -> list[Piece]:
    return [(piece, tuple(allowed.values())[:2])]


def test_who_is_full_stays_where_it_has_all_and_is_taken_nowhere_else() -> None:
    whole = Segment(THIRDS, arc(10, 19), (Configuration(1, (P, A, B), 2),))
    found = Configurations(P, 1, (whole, Segment(THIRDS, arc(20, 29), sound=frozenset({B}))))
    assert around_full(found, THIRDS, arc(0, 39), ALLOWED, frozenset({A}), first_two) == [
        (arc(0, 9), (B, C)),
        (arc(10, 19), (A, B)),
        (arc(20, 29), (B, C)),
        (arc(30, 39), (B, C)),
    ]
    assert around_full(found, THIRDS, arc(0, 39), ALLOWED, frozenset(), first_two) == [(arc(0, 39), (A, B))]
    assert around_full(found, (), arc(0, 39), ALLOWED, frozenset({A, B, C}), first_two) == [(arc(0, 39), ())]


def test_it_is_asked_again_once_it_says_that_it_has_room_and_some_time_has_passed() -> None:
    class Now:
        at = 0.0

        def now(self) -> float:
            return self.at

    def said(part: float) -> Any:
        return SimpleNamespace(offline_blocks=1_000, offline_fraction=int(part * 2**32))

    now = Now()
    statuses: dict[NodeId, Any] = {}
    full = FullHolders(cast(Any, now), cast(Any, SimpleNamespace(status=statuses.get)))
    assert full.among([A, B]) == frozenset()
    full.note(A)
    statuses[A.node] = said(0.2)
    assert full.among([A, B]) == {A}
    now.at, statuses[A.node] = AGAIN_S_MIN, said(0.99)
    assert full.among([A, B]) == {A}
    statuses[A.node] = said(0.5)
    assert full.among([A, B]) == frozenset()
    for pause_s in (60.0, 120.0, 240.0, 480.0, AGAIN_S_MAX, AGAIN_S_MAX):
        for _ in range(3):
            full.note(A)
        now.at += pause_s - 1.0
        assert full.among([A]) == {A}
        now.at += 1.0
        assert full.among([A]) == frozenset()
    now.at += FORGOTTEN_S + 1.0
    full.note(A)
    now.at += AGAIN_S_MIN
    assert full.among([A]) == frozenset()


async def no_room(puts: Sequence[Put]) -> list[PutResult]:
    return [PutResult(Outcome.FULL)] * len(puts)


def test_a_full_disk_does_not_hold_up_the_change_of_a_segment(monkeypatch: pytest.MonkeyPatch) -> None:
    async def main(terrace: Terrace, _nursery: trio.Nursery) -> None:
        first = terrace.homes[0]
        spots = await filled(terrace, 6)
        former, other = holders_of(terrace, first, spots[0])
        mine = [place for place in spots if holders_of(terrace, first, place) == [former, other]]
        left = [home for home in terrace.homes if home not in (first, former, other)]
        with monkeypatch.context() as patches:
            for home in left:
                patches.setattr(home.store, "hold", no_room)
            assert first.own is not None
            first.own.blacklist = Blacklist(1, (AddressPrefix(former.node, ADDRESS_BITS),))
            full = first.replication.placing.full
            await until(lambda: bool(full.among([home.member for home in left])))
        noted = full.among([home.member for home in left])
        (late,) = [home for home in left if home.member in noted]
        monkeypatch.setattr(late.store, "hold", no_room)
        document = await first.replication.health.document()
        assert document["full"] == [late.address]
        await until(lambda: late not in holders_of(terrace, first, mine[0]) and is_settled(first))
        assert lies_with_all(terrace, first, mine)
        assert former not in holders_of(terrace, first, mine[0])

    played(main, homes=5, seed=31)
