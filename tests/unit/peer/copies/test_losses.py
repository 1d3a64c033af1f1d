"""If one fails, a cluster is called healthy that has lost what it had promised to keep, or people are called for nothing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import pytest

from scenefold.base.errors import DamagedData
from scenefold.base.ids import NodeId
from scenefold.base.location import FIRST, Arc, Location
from scenefold.peer.copies.entries import Entry, alike
from scenefold.peer.copies.losses import Loss, losses_in
from scenefold.peer.copies.losses_note import ACKNOWLEDGED_MAX, Losses, decode_losses, encode_losses, id_of
from scenefold.wire import Member, NotedLoss, pack_value
from scenefold.wire.copy_packets import Span
from scenefold.wire.loss_packets import LOSS_ARCS_MAX, LOSSES_KEPT_MAX
from unit.peer.copies.test_configurations import ONE, TWO, A, B, C, D, P, Q, arc

GAP = arc(0, 99)
ASKED = {ONE: 2}


def entry(members: Sequence[Member], *, where: Arc = GAP, number: int = 5, needed: int = 2, whole: bool = True) -> Entry:
    return Entry(ONE, where, number, tuple(members), needed, whole)


def lost(
    told: Mapping[Member, Sequence[Entry]],
    *gone: Member,
    silent: Sequence[Member] = (C, D),
    asked: dict = ASKED,
    gap: Arc = GAP,
    remembers: bool = True,
) -> list[Loss]:
    heard = {**{member: () for member in silent if member not in gone}, **told}
    return losses_in(Q, gap, asked, heard, gone.__contains__, gone, remembers=remembers)


def test_one_that_is_lost_takes_nothing_along() -> None:
    both = entry([P, A, B])
    assert lost({A: [both], B: [both]}, P) == []
    filled = entry([P, A, C], number=7, whole=False)
    assert lost({A: [both], B: [both], C: [filled]}, P) == [], "nor while holders change"
    assert lost({A: [filled]}, P, silent=(B, C)) == [], "nor if nothing was complete yet: so few cannot have been all"


def test_where_all_are_gone_who_held_it_everything_may_be_lost() -> None:
    (found,) = lost({}, P, A, B)
    assert found == Loss(3, False, (P, A, B), (GAP,))
    left = entry([P, A, C], where=arc(0, 49))
    cut = lost({A: [left], C: [left]}, P, B)
    assert cut == [Loss(3, False, (P, B), (arc(50, 99),))], "only there"


def test_where_as_many_are_gone_as_a_write_needed_the_newest_may_be_lost() -> None:
    assert lost({B: [entry([P, A, B])]}, P, A) == [Loss(3, True, (P, A), (GAP,))]
    assert lost({B: [entry([P, A, B], needed=3)]}, P, A) == [], "what three must have one has that is left"
    assert lost({B: [entry([P, A, B], needed=1)]}, P, asked={ONE: 1}) == [], "who lets one disk be enough is promised nothing"


def test_who_was_being_filled_has_not_all() -> None:
    filled = entry([P, C, D], number=9, whole=False)
    assert lost({C: [filled], D: [filled]}, P, A, B) == [Loss(3, False, (P, A, B), (GAP,))]
    old = entry([P, A, B])
    assert lost({B: [old], C: [entry([P, C, A], number=9, whole=False)]}, P, A, silent=(D,)) == [Loss(3, True, (P, A), (GAP,))]


def test_a_configuration_that_nobody_has_heard_of_may_have_counted() -> None:
    """A, who was a member, holds nothing any more: so there was another one since, and all of that may be gone."""
    stale = entry([P, A, B])
    own = entry([P, Q, B])
    assert lost({B: [own], Q: ()}, P, C, D) == [Loss(3, True, (P, C, D), (GAP,))], "who asks was told itself that it holds nothing"
    assert lost({B: [own], Q: ()}, P, C, D, remembers=False) == [], "once it was started anew it does not know that"
    assert lost({B: [own], Q: [own]}, P, C, D) == []
    assert lost({B: [stale], A: ()}, P, C, D) == [Loss(3, True, (P, C, D), (GAP,))]


def test_who_was_away_while_the_others_left_knows_of_no_later_configuration() -> None:
    """B was away. A was drained, or P gave the place to another owner: that one needs B for no write, and B says what was so before."""
    stale = entry([P, A, B])
    everything = Loss(3, True, (P, C), (GAP,))
    assert lost({B: [stale]}, P, C, silent=(D,)) == [everything], "A is neither lost nor asked, so it was drained"
    assert lost({B: [stale], P: ()}, C, A, silent=(D,)) == [Loss(3, True, (C, A), (GAP,))], "P has given it to C"
    newer = entry([C, A, D], number=9, whole=False)
    assert lost({B: [stale], A: [newer]}, P, Q, silent=(D,)) == [Loss(3, True, (P, Q), (GAP,))], "A holds for another owner by now"
    assert lost({B: [stale]}, P, silent=(D,)) == [], "one alone was not all that had it"


def test_what_enough_still_hold_binds_every_later_write() -> None:
    old, newer = entry([P, A, B]), entry([P, A, D], number=7)
    assert lost({A: [newer], B: [old], D: [newer]}, P, C, silent=()) == []
    assert lost({A: [newer], B: [old], D: [old]}, P, C, silent=()) == [], "D has not heard of the newer one, so it holds for it as well"
    wide = entry([P, A, B, D], needed=3)
    assert lost({A: [wide], B: [wide]}, P, D, C, silent=()) == [], "two of three are enough where three had to have it"


def test_a_layout_of_no_space_and_what_was_never_held_with_nobody_lost() -> None:
    assert lost({}, P, A, B, asked={}) == []
    assert lost({}, asked={ONE: 2, TWO: 2}) == []
    assert lost({}, P, asked={ONE: 2, TWO: 2}) == []
    assert lost({}, P, A, asked={(): 1}) == [], "one copy is promised nothing"


def test_many_parts_are_named_by_what_covers_them() -> None:
    told = [entry([P, A, C], where=arc(2 * index, 2 * index)) for index in range(50)]
    (found,) = lost({A: told, C: told}, P, B)
    assert len(found.arcs) == LOSS_ARCS_MAX and found.arcs[0] == arc(1, 1) and found.arcs[-1].last == arc(99, 99).last


def test_parts_in_which_all_say_one_thing_are_found_in_one_pass() -> None:
    """Whoever lies may name thousands of entries: the node that adopts must not stand still over them, and lose its lease."""
    looks = 0

    class Counted(Arc):
        def __contains__(self, location: Location) -> bool:
            nonlocal looks
            looks += 1
            return super().__contains__(location)

    tiny = [Counted(*(Location.from_number(number) for number in (4 * index, 4 * index + 1))) for index in range(1000)]
    gap = Counted(FIRST, tiny[-1].last)
    parts = list(alike({A: [entry([P, A], where=where) for where in tiny], B: [entry([P, B], where=gap)]}, gap))
    assert [where for where, told in parts if A in told] == [Arc(where.first, where.last) for where in tiny]
    assert parts[0][0].first == gap.first and parts[-1][0].last == gap.last and len(parts) == 1999
    assert all(B in told for _, told in parts) and looks <= 2 * len(tiny)
    over = list(alike({A: [entry([P, A]), entry([P, A], where=arc(10, 20))]}, GAP))
    assert [where.first for where, _ in over] == [arc(0, 0).first, arc(10, 10).first, arc(21, 21).first], "of a liar's, one"


# ---------------------------------------------------------------------------------------------------------------- kept


def noted(number: int = 1, *, ms: int = 7) -> NotedLoss:
    return NotedLoss(NodeId(number), ms, 3, False, (P, Q), (Span(GAP.first, GAP.last),))


def test_what_is_kept_is_acknowledged_once_for_all() -> None:
    losses = Losses().add(noted(), noted(2))
    assert losses.add(noted(ms=9)) is losses, "the same, found again"
    seen = losses.acknowledge((id_of(noted()),))
    assert seen.kept == (noted(2),)
    assert seen.add(noted()) is seen and seen.acknowledge((id_of(noted()),)) is seen
    assert decode_losses(encode_losses(seen)) == seen


def test_what_is_kept_has_bounds() -> None:
    crowded = Losses().add(*(replace(noted(1), copies=copies, removed=(P,) * many) for copies in range(2, 9) for many in range(17)))
    assert len(crowded.kept) == LOSSES_KEPT_MAX and crowded.add(noted(2)).kept == (*crowded.kept[:-1], noted(2)), (
        "whoever notes most gives way"
    )
    losses = Losses().add(*map(noted, range(100)))
    assert len(losses.kept) == LOSSES_KEPT_MAX and losses.kept[0] == noted(0)
    seen = losses.acknowledge(tuple(number.to_bytes(16, "big") for number in range(300)))
    assert len(seen.acknowledged) == ACKNOWLEDGED_MAX
    assert decode_losses(encode_losses(seen)) == seen


@pytest.mark.parametrize(
    "note", [b"", b"\x80", pack_value({"v": 2, "losses": [], "acknowledged": []}), pack_value({"v": 1, "losses": [[1]]})]
)
def test_another_note_is_damaged(note: bytes) -> None:
    with pytest.raises(DamagedData):
        decode_losses(note)
