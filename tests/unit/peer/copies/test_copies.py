"""If one fails, a node owns a piece and has forgotten who may still be answered for it, or gives away what it does not know itself."""

from __future__ import annotations

from dataclasses import replace

import hypothesis.strategies as st
import pytest
from hypothesis import given, settings

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.ids import NodeId
from scenefold.base.location import WHOLE_LINE, Arc, Location
from scenefold.base.reasons import RejectReason
from scenefold.peer.copies.configurations import Configurations
from scenefold.peer.copies.copies import Copies, Passing
from scenefold.peer.copies.copies_note import check_copies, decode_copies, encode_copies
from scenefold.peer.copies.custody import Custody
from scenefold.peer.copies.entries import Entry
from scenefold.peer.copies.segment import Segment
from scenefold.peer.copies.telling import claim_of
from scenefold.peer.line.ends import Side
from scenefold.peer.line.holding import Holding, handover_id
from scenefold.wire import ClaimRange, Configuration, Member, decode_packet, encode_packet, pack_value, unpack_value
from unit.peer.copies.test_configurations import ONE, A, B, P, Q, arc, changed

RIGHT_HALF = arc(50, 99)


def kept(copies: Copies) -> Copies:
    """As it comes back from the disk."""
    return decode_copies(encode_copies(copies), copies.configurations.me)


def step(before: tuple[Holding, Copies], after: Holding, told: Passing | None = None) -> tuple[Holding, Copies]:
    """One durable change of both."""
    return after, kept(before[1].follow(before[0], after, told))


def owner() -> tuple[Holding, Copies]:
    """P with 0 to 99, of which A and B hold copies."""
    return Holding().found(arc(0, 99)), Copies(changed(Configurations(P), A, B))


def receiver() -> tuple[Holding, Copies]:
    """Q with what comes behind that, which held copies of P's places before."""
    held = Entry(ONE, arc(0, 99), 3, (P, Q, A), 2, whole=True)
    return Holding().found(arc(100, 199)), Copies(Configurations(Q), Custody().set(P, 3, arc(0, 99), [held]))


def offered(giver: tuple[Holding, Copies]) -> tuple[bytes, tuple[Holding, Copies]]:
    handover = handover_id(giver[0].revision + 1, bytes(8))
    return handover, step(giver, giver[0].offer(handover, Side.RIGHT, Q, RIGHT_HALF))


def released() -> tuple[bytes, tuple[Holding, Copies]]:
    handover, giver = offered(owner())
    return handover, step(giver, giver[0].release(handover))


def test_what_is_released_is_told_until_the_receiver_has_it() -> None:
    handover, giver = released()
    told = giver[1].passed(handover)
    assert told is not None and [segment.arc for segment in told.segments] == [RIGHT_HALF]
    assert giver[1].configurations.at(ONE, Location.from_number(50)) is None
    assert giver[1].configurations.at(ONE, Location.from_number(49)) is not None
    late = Entry(ONE, RIGHT_HALF, told.number - 1, (Q, P), 1, whole=True)
    with pytest.raises(Refused):
        giver[1].custody.set(Q, late.number, RIGHT_HALF, [late])
    holding, copies = step(giver, giver[0].confirm(handover, lambda _: False))
    assert copies.passing == ()
    assert not copies.unrecovered
    assert step((holding, copies), holding.finish(handover))[1] == copies


def test_who_claims_a_piece_knows_who_may_be_answered_for_it_and_holds_nothing_there_for_others() -> None:
    handover, giver = released()
    told = giver[1].passed(handover)
    assert told is not None
    taker = receiver()
    assert taker[1].custody.within(RIGHT_HALF)
    taker = step(taker, taker[0].note(handover, Side.LEFT, P, RIGHT_HALF))
    taker = step(taker, taker[0].claim(handover, RIGHT_HALF), told)
    segment = taker[1].configurations.at(ONE, Location.from_number(50))
    assert segment is not None and segment.newest is not None
    assert set(segment.newest.members) == {P, A, B}
    assert taker[1].configurations.number > told.number
    assert not taker[1].custody.within(RIGHT_HALF)
    assert taker[1].custody.within(arc(0, 49)), "what is still the giver's is held on"
    assert taker[1].is_recovered(arc(50, 50))
    # Told again, since the answer was lost.
    assert taker[1].follow(taker[0], taker[0].claim(handover, RIGHT_HALF), told) is taker[1]


@pytest.mark.parametrize("told", [None, Passing(bytes(16), 1, ())])
def test_a_piece_of_which_nothing_is_told_is_unrecovered(told: Passing | None) -> None:
    handover, _ = released()
    taker = receiver()
    taker = step(taker, taker[0].note(handover, Side.LEFT, P, RIGHT_HALF))
    taker = step(taker, taker[0].claim(handover, RIGHT_HALF), told)
    assert taker[1].unrecovered == (RIGHT_HALF,)
    assert not taker[1].is_recovered(arc(50, 50))
    assert taker[1].is_recovered(arc(100, 199))


@settings(deadline=None)
@given(st.lists(st.integers(0, 49), unique=True, max_size=6).map(sorted), st.integers(0, 99), st.integers(0, 99))
def test_a_piece_is_cut_where_what_is_known_ends(bounds: list[int], one: int, other: int) -> None:
    gaps = zip(bounds[::2], bounds[1::2], strict=False)
    copies = replace(receiver()[1], unrecovered=tuple(arc(2 * first, 2 * last) for first, last in gaps))
    rest: Arc | None = arc(min(one, other), max(one, other))
    while rest is not None:
        part, is_known = copies.recovered_part(rest)
        assert part.first == rest.first
        for place in range(part.first.number, part.last.number + 1):
            assert copies.is_recovered(arc(place, place)) == is_known
        following = part.last.next()
        rest = Arc(following, rest.last) if part.last < rest.last and following is not None else None


def test_a_piece_that_is_taken_back_is_unrecovered() -> None:
    handover, giver = released()
    giver = step(giver, giver[0].take_back(handover, lambda member: member == Q))
    assert giver[0].arc == arc(0, 99)
    assert giver[1].passing == () and giver[1].unrecovered == (RIGHT_HALF,)
    assert giver[1].configurations.at(ONE, Location.from_number(50)) is None


def test_a_gap_is_unrecovered_until_all_have_said_what_they_hold() -> None:
    taker = receiver()
    gap = arc(0, 99)
    taker = step(taker, taker[0].adopt(gap, revision=taker[0].revision))
    assert taker[1].unrecovered == (gap,) and not taker[1].custody.within(gap)
    held = Entry(ONE, gap, 3, (P, Q, A), 2, whole=True)
    once = kept(taker[1].recover(arc(0, 9), {A: [held]}, 1 << 32))
    assert once.unrecovered == (arc(10, 99),)
    copies = kept(once.recover(arc(10, 99), {A: [held]}, 1 << 32))
    assert copies.unrecovered == () and copies.configurations.number >= 1 << 32
    segment = copies.configurations.at(ONE, Location.from_number(5))
    assert segment is not None and segment.newest is not None and segment.newest.members == (P, Q, A)
    with pytest.raises(Refused):
        copies.recover(gap, {}, 2 << 32)


def test_who_says_another_configuration_of_the_same_number_keeps_nobody_from_reading_the_note() -> None:
    """Nobody can tell who of them lies, so both count until the one who does is removed; and both pass on to a later owner."""
    taker, gap = receiver(), arc(0, 99)
    taker = step(taker, taker[0].adopt(gap, revision=taker[0].revision))
    true, lies = [Entry(ONE, gap, 3, (P, Q, A), 2, whole=True)], [Entry(ONE, gap, 3, (P, B), 2, whole=True)]
    for heard in ({A: true, B: lies}, {B: lies, A: true}):
        copies = kept(taker[1].recover(gap, heard, 1 << 32))
        segment = copies.configurations.at(ONE, Location.from_number(5))
        assert segment is not None
        assert [found.members for found in segment.configurations] == [(P, Q, A), (P, B)]
        assert not segment.is_settled({Q, A}, 2, Q), "who lies holds up what is written there, and no more than that"
    handover = handover_id(taker[0].revision + 1, bytes(8))
    giver = step((taker[0], copies), taker[0].offer(handover, Side.LEFT, P, gap))
    giver = step(giver, giver[0].release(handover))
    told = decode_packet(encode_packet(claim_of(handover, gap, giver[1].passed(handover))))
    assert isinstance(told, ClaimRange) and len(told.segments[0].configurations) == 2


@pytest.mark.parametrize(
    "wrong",
    [
        [Segment(ONE, arc(0, 9), (Configuration(9, (P, A), 2),))],
        [Segment(ONE, arc(0, 9), (Configuration(2, (P, A), 2), Configuration(2, (P, A), 2)))],
        [Segment(ONE, arc(0, 9), (Configuration(2, (P, A), 2), Configuration(1, (P, A), 2)))],
        [Segment(ONE, arc(0, 9)), Segment(ONE, arc(9, 20))],
    ],
)
def test_what_could_not_be_read_again_is_never_written(wrong: list[Segment]) -> None:
    copies = Copies(Configurations(P, 5, tuple(wrong)))
    with pytest.raises(ValueError, match=r"order|highest"):
        check_copies(copies)
    with pytest.raises(ValueError, match=r"order|highest"):
        check_copies(replace(Copies.of(P), passing=(Passing(bytes(16), 5, tuple(wrong)),)))
    with pytest.raises(DamagedData):
        kept(copies)


def test_who_adopts_what_it_held_answers_for_it_as_before_until_all_is_known() -> None:
    """Nobody acknowledges anything there until then, so what it and the other holders have is still the newest."""
    gap = arc(0, 99)
    held = [Entry(ONE, arc(0, 49), 3, (P, Q, A), 2, whole=True), Entry(ONE, arc(50, 99), 4, (P, Q, A), 2, whole=False)]
    holding, copies = Holding(), replace(Copies.of(Q), custody=Custody(tuple(held)))
    after = holding.adopt(gap, revision=holding.revision)
    adopted = copies.follow(holding, after)
    low, middle, high = (Location.from_number(number) for number in (5, 30, 70))
    assert not adopted.custody.entries
    assert adopted.answers(ONE, low) == held[0], "under the configuration of before"
    assert adopted.answers(ONE, high) is None, "of this it never had all"
    assert adopted.answers((Location.from_number(9),), low) is None
    part = adopted.recover(arc(0, 19), {}, 1 << 32)
    assert part.answers(ONE, low) is None and part.answers(ONE, middle) is not None
    assert part.recover(arc(20, 99), {}, 1 << 32).formerly == ()
    assert kept(adopted) == replace(adopted, formerly=()), "it is of use for some seconds, and not after a start"


def test_an_unrecovered_piece_is_not_given_away() -> None:
    holding, copies = Holding(), Copies.of(P)
    holding, copies = step((holding, copies), holding.adopt(WHOLE_LINE, revision=0))
    piece = Arc(Location.from_number(5), WHOLE_LINE.last)
    handover = handover_id(holding.revision + 1, bytes(8))
    holding, copies = step((holding, copies), holding.offer(handover, Side.RIGHT, Q, piece))
    with pytest.raises(Refused) as refused:
        copies.follow(holding, holding.release(handover))
    assert refused.value.reason is RejectReason.NOT_READY
    copies = copies.recover(WHOLE_LINE, {}, 7)
    after = copies.follow(holding, holding.release(handover))
    assert after.passed(handover) == Passing(handover, 8, ())


def test_a_handover_that_comes_to_nothing_changes_nothing() -> None:
    handover, giver = offered(owner())
    assert giver[1].follow(giver[0], giver[0].withdraw(handover)) is giver[1]
    taker = receiver()
    noted = taker[0].note(handover, Side.LEFT, P, RIGHT_HALF)
    assert taker[1].follow(taker[0], noted) is taker[1]
    assert taker[1].follow(noted, noted.drop(handover)) is taker[1]


def test_neighbouring_gaps_become_one() -> None:
    holding, copies = Holding().found(arc(50, 59)), Copies.of(P)
    holding, copies = step((holding, copies), holding.adopt(arc(60, 69), revision=holding.revision))
    holding, copies = step((holding, copies), holding.adopt(arc(40, 49), revision=holding.revision))
    assert copies.unrecovered == (arc(40, 49), arc(60, 69))
    holding, copies = step((holding, copies), holding.adopt(arc(70, 79), revision=holding.revision))
    assert copies.unrecovered == (arc(40, 49), arc(60, 79))


def _spoilt(change: object) -> bytes:
    value = unpack_value(encode_copies(released()[1][1]))
    assert isinstance(change, dict)
    return pack_value({**value, **change})


@pytest.mark.parametrize(
    "note",
    [
        b"",
        b"\x80",
        _spoilt({"v": 2}),
        _spoilt({"more": 1}),
        _spoilt({"custody": b""}),
        _spoilt({"configurations": b"\x80"}),
        _spoilt({"passing": [[b"short", b""]]}),
        _spoilt({"unrecovered": [[bytes(20), bytes(20)], [bytes(20), bytes(20)]]}),
        _spoilt({"unrecovered": [[b"\xff" * 20, bytes(20)]]}),
    ],
    ids=["empty", "no fields", "version", "a field more", "custody", "configurations", "passing", "twice", "backwards"],
)
def test_a_note_that_is_none_is_damaged(note: bytes) -> None:
    with pytest.raises(DamagedData):
        decode_copies(note, P)


def test_another_incarnations_note_is_not_taken() -> None:
    with pytest.raises(DamagedData, match="another incarnation"):
        decode_copies(encode_copies(Copies.of(P)), Member(NodeId(P.node), b"x" * 16))
