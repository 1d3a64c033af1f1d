"""If one fails, a safeguard of the line no longer guards, or guards nothing: each story goes well with it, and badly without.

What a safeguard keeps from happening is told with real holdings, rules and surveys; time, crashes and packets that come in
any order are in test_crashes and test_line_model.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

import pytest

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId
from scenefold.base.location import Arc
from scenefold.peer.line import rules, survey
from scenefold.peer.line.ends import Side
from scenefold.peer.line.holding import Holding, handover_id
from scenefold.peer.line.survey import Unsettled, surveys
from scenefold.wire import Member
from unit.peer.line.bent import bend
from unit.peer.line.line_nodes import View, arc_of_cells, cells_of

FAR, NEAR, EMPTY, ASKER = (Member(NodeId(number), bytes([number]) * 16) for number in (10, 20, 30, 40))
SALT = b"s" * 8
Cast = dict[Member, Holding]


def view(*members: Member, position: int = 1, removed: tuple[Member, ...] = ()) -> View:
    return View(position, tuple(member.node for member in members), {member.node: member for member in members}, removed)


def owning(first: int, last: int) -> Holding:
    return Holding().found(arc_of_cells(first, last))


def begun(cast: Cast, giver: Member, side: Side, receiver: Member, piece: Arc) -> bytes:
    """The giver has offered, the receiver noted."""
    identity = handover_id(cast[giver].revision + 1, SALT)
    cast[giver] = cast[giver].offer(identity, side, receiver, piece)
    cast[receiver] = cast[receiver].note(identity, side.opposite, giver, piece)
    return identity


def passed(cast: Cast, giver: Member, side: Side, receiver: Member, piece: Arc) -> bytes:
    """A whole handover, to its end on both sides."""
    identity = begun(cast, giver, side, receiver, piece)
    cast[giver] = cast[giver].release(identity)
    cast[receiver] = cast[receiver].claim(identity, piece)
    cast[giver] = cast[giver].confirm(identity, lambda _member: False)
    cast[receiver] = cast[receiver].drop(identity)
    cast[giver] = cast[giver].finish(identity)
    return identity


def no_place_twice(cast: Cast) -> None:
    cells = [cell for holding in cast.values() for cell in cells_of(holding.arc)]
    assert len(cells) == len(set(cells)), "a place has two owners"


def surveyed(cast: Cast, views: dict[Member, View], after: dict[int, Callable[[], object]] | None = None) -> Arc | None:
    """What the asker's first survey finds. `after`: what happens behind its back after the n-th answer."""
    me = views[ASKER]
    found = surveys(cast[ASKER], me, ASKER.node)[0]
    asked = 0
    try:
        node = next(found)
        while True:
            member = me.members[node]
            bound = rules.bound_for(cast[member], views[member], member, ASKER, me.position)
            asked += 1
            if after is not None and asked in after:
                after[asked]()
            node = found.send(bound)
    except StopIteration as end:
        gap: Arc | None = end.value
        return gap
    except (Unsettled, Refused):
        return None


def adopt(cast: Cast, gap: Arc | None, revision: int) -> None:
    if gap is not None:
        cast[ASKER] = cast[ASKER].adopt(gap, revision=revision)


# ------------------------------------------------------------------------------------------------------------ stories


def a_piece_passes_behind_the_askers_back() -> None:
    """Between two answers, NEAR gives all it has to the empty node that was asked already."""
    cast = {FAR: owning(0, 3), NEAR: owning(4, 7), EMPTY: Holding(), ASKER: owning(8, 15)}
    everybody = view(*cast)
    gap = surveyed(cast, dict.fromkeys(cast, everybody), {1: lambda: passed(cast, NEAR, Side.RIGHT, EMPTY, arc_of_cells(4, 7))})
    adopt(cast, gap, cast[ASKER].revision)
    no_place_twice(cast)


def a_newcomer_that_the_asker_does_not_know() -> None:
    cast = {FAR: owning(0, 7), EMPTY: Holding(), ASKER: owning(8, 15)}
    before, now = view(FAR, ASKER), view(FAR, EMPTY, ASKER, position=2)
    passed(cast, FAR, Side.RIGHT, EMPTY, arc_of_cells(4, 7))
    adopt(cast, surveyed(cast, {FAR: now, EMPTY: now, ASKER: before}), cast[ASKER].revision)
    no_place_twice(cast)


def an_adopter_that_has_given_meanwhile() -> None:
    """Two looks find the same gap; between the first one's end and the second's the gap was adopted and given on."""
    cast = {FAR: owning(0, 3), EMPTY: Holding(), ASKER: owning(8, 15)}
    everybody = dict.fromkeys(cast, view(*cast))
    revision, gap = cast[ASKER].revision, surveyed(cast, everybody)
    adopt(cast, gap, revision)
    assert gap == arc_of_cells(4, 7)
    passed(cast, ASKER, Side.LEFT, EMPTY, gap)
    with suppress(Refused):
        adopt(cast, gap, revision)
    no_place_twice(cast)


def offers_and_claims_that_come_late() -> None:
    """A piece went right and came back; then the first handover's packets come once more."""
    cast = {FAR: owning(0, 7), NEAR: owning(8, 15)}
    piece = arc_of_cells(6, 7)
    late = passed(cast, FAR, Side.RIGHT, NEAR, piece)
    passed(cast, NEAR, Side.LEFT, FAR, piece)
    with suppress(Refused):
        cast[NEAR] = cast[NEAR].note(late, Side.LEFT, FAR, piece).claim(late, piece)
    no_place_twice(cast)


def a_claim_of_a_handover_that_has_ended() -> None:
    """The same without a late offer: nobody has noted that id any more."""
    cast = {FAR: owning(0, 7), NEAR: owning(8, 15)}
    piece = arc_of_cells(6, 7)
    late = passed(cast, FAR, Side.RIGHT, NEAR, piece)
    passed(cast, NEAR, Side.LEFT, FAR, piece)
    with pytest.raises(Refused):
        cast[NEAR].claim(late, piece)


def two_givers_that_do_not_touch() -> None:
    """An empty node between two arcs with a gap between them: what was noted can be claimed, in any order."""
    cast = {FAR: owning(0, 7), EMPTY: Holding(), ASKER: owning(10, 15)}
    given = {begun(cast, FAR, Side.RIGHT, EMPTY, arc_of_cells(6, 7)): arc_of_cells(6, 7)}
    with suppress(Refused):
        given[begun(cast, ASKER, Side.LEFT, EMPTY, arc_of_cells(10, 11))] = arc_of_cells(10, 11)
    for identity, piece in given.items():
        try:
            cast[EMPTY] = cast[EMPTY].claim(identity, piece)
        except Refused:
            raise AssertionError("a released piece has no taker") from None


def a_giver_that_was_removed_half_way() -> None:
    """What it had offered to the empty node keeps nobody from adopting what it owned."""
    cast = {FAR: owning(0, 3), NEAR: owning(4, 7), EMPTY: Holding(), ASKER: owning(8, 15)}
    begun(cast, NEAR, Side.RIGHT, EMPTY, arc_of_cells(4, 7))
    now = view(FAR, EMPTY, ASKER, position=2, removed=(NEAR,))
    for member in (FAR, EMPTY, ASKER):
        cast[member] = cast[member].drop_removed(now.removals.__contains__)
    assert surveyed(cast, dict.fromkeys(cast, now)) == arc_of_cells(4, 7), "the gap stays"


def a_claim_by_a_giver_that_was_removed() -> None:
    """It has released before it could know; the claim arrives after the gap was adopted."""
    cast = {FAR: owning(0, 3), NEAR: owning(4, 7), EMPTY: Holding(), ASKER: owning(8, 15)}
    late = begun(cast, NEAR, Side.RIGHT, EMPTY, arc_of_cells(4, 7))
    now = view(FAR, EMPTY, ASKER, position=2, removed=(NEAR,))
    for member in (FAR, EMPTY, ASKER):
        cast[member] = cast[member].drop_removed(now.removals.__contains__)
    cast[NEAR] = cast[NEAR].release(late)
    adopt(cast, arc_of_cells(4, 7), cast[ASKER].revision)
    with suppress(Refused):
        cast[EMPTY] = cast[EMPTY].claim(late, arc_of_cells(4, 7))
    no_place_twice(cast)


def a_piece_that_is_on_its_way() -> None:
    """Released by FAR, not claimed yet by the empty node: nobody owns it, and it is no gap."""
    cast = {FAR: owning(0, 7), EMPTY: Holding(), ASKER: owning(8, 15)}
    piece = arc_of_cells(4, 7)
    identity = begun(cast, FAR, Side.RIGHT, EMPTY, piece)
    cast[FAR] = cast[FAR].release(identity)
    adopt(cast, surveyed(cast, dict.fromkeys(cast, view(*cast))), cast[ASKER].revision)
    cast[EMPTY] = cast[EMPTY].claim(identity, piece)
    no_place_twice(cast)


PIECE = arc_of_cells(4, 7)


def released() -> tuple[Cast, bytes, View]:
    """FAR has released a piece to the empty node, which is removed before FAR has heard of a claim."""
    cast = {FAR: owning(0, 7), EMPTY: Holding(), ASKER: owning(8, 15)}
    identity = begun(cast, FAR, Side.RIGHT, EMPTY, PIECE)
    cast[FAR] = cast[FAR].release(identity)
    return cast, identity, view(FAR, ASKER, position=2, removed=(EMPTY,))


def learn(cast: Cast, now: View) -> None:
    for member in [member for member in cast if member not in now.removals]:
        cast[member] = cast[member].drop_removed(now.removals.__contains__)


def a_receiver_that_never_claimed() -> None:
    """The giver has every record of the piece: nobody else may own it, and it owns it again."""
    cast, identity, now = released()
    learn(cast, now)
    assert surveyed(cast, dict.fromkeys(cast, now)) is None, "whoever adopts the place has no record of it"
    cast[FAR] = cast[FAR].take_back(identity, now.removals.__contains__)
    assert cast[FAR].arc == arc_of_cells(0, 7)
    assert surveyed(cast, dict.fromkeys(cast, now)) is None, "no gap is left"


def a_receiver_that_would_pass_on_what_its_giver_may_take_back() -> None:
    cast, identity, now = released()
    cast[EMPTY] = cast[EMPTY].claim(identity, PIECE)
    with suppress(Refused):
        passed(cast, EMPTY, Side.RIGHT, ASKER, PIECE)
    del cast[EMPTY]
    learn(cast, now)
    cast[FAR] = cast[FAR].take_back(identity, now.removals.__contains__)
    no_place_twice(cast)


def a_confirmation_that_comes_after_the_removal() -> None:
    cast, identity, now = released()
    learn(cast, now)
    with suppress(Refused):
        cast[FAR] = cast[FAR].confirm(identity, now.removals.__contains__)
    learn(cast, now)
    cast[FAR] = cast[FAR].take_back(identity, now.removals.__contains__)
    assert cast[FAR].arc == arc_of_cells(0, 7), "the records are here, and others may own their places"


def a_piece_that_is_taken_back_from_a_member() -> None:
    cast, identity, _ = released()
    with suppress(Refused):
        cast[FAR] = cast[FAR].take_back(identity, lambda _member: False)
    cast[EMPTY] = cast[EMPTY].claim(identity, PIECE)
    no_place_twice(cast)


def an_empty_giver_that_notes_what_does_not_touch() -> None:
    """What it has released may come back: then what it has noted on the other side could not be claimed any more."""
    cast = {FAR: owning(0, 3), NEAR: owning(4, 7), ASKER: owning(10, 15)}
    identity = begun(cast, NEAR, Side.LEFT, FAR, PIECE)
    cast[NEAR] = cast[NEAR].release(identity)
    piece = arc_of_cells(10, 11)
    with suppress(Refused):
        other = begun(cast, ASKER, Side.LEFT, NEAR, piece)
        cast[NEAR] = cast[NEAR].take_back(identity, lambda member: member == FAR)
        try:
            cast[NEAR] = cast[NEAR].claim(other, piece)
        except Refused:
            raise AssertionError("a released piece has no taker") from None


GUARDS = [
    pytest.param(a_receiver_that_never_claimed, Holding, "drop_removed", "found.step is not Step.RELEASED and ", "", id="released is kept"),
    pytest.param(
        a_receiver_that_would_pass_on_what_its_giver_may_take_back,
        Holding,
        "offer",
        "self.may_be_taken_back(piece)",
        "False",
        id="taken is not passed on",
    ),
    pytest.param(
        a_confirmation_that_comes_after_the_removal,
        Holding,
        "confirm",
        "is_removed(known.peer)",
        "False",
        id="removed peers confirm nothing",
    ),
    pytest.param(
        a_piece_that_is_taken_back_from_a_member,
        Holding,
        "take_back",
        "not is_removed(known.peer)",
        "False",
        id="members keep what they get",
    ),
    pytest.param(
        an_empty_giver_that_notes_what_does_not_touch,
        Holding,
        "_fits",
        "(Step.NOTED, Step.RELEASED)",
        "(Step.NOTED,)",
        id="released touches",
    ),
    pytest.param(a_piece_passes_behind_the_askers_back, survey, "_confirmed", "in passed:", "in passed[:0]:", id="second round of asking"),
    pytest.param(
        a_newcomer_that_the_asker_does_not_know, rules, "bound_for", "standing.position != position", "False", id="equal log positions"
    ),
    pytest.param(an_adopter_that_has_given_meanwhile, Holding, "adopt", "revision != self.revision", "False", id="revision of the adopter"),
    pytest.param(
        offers_and_claims_that_come_late, Holding, "note", "number_of(handover) <= self._heard_from(giver)", "False", id="heard numbers"
    ),
    pytest.param(
        two_givers_that_do_not_touch,
        Holding,
        "_fits",
        "other is None or other.step not in (Step.NOTED, Step.RELEASED) or touches(piece, other.piece, side)",
        "True",
        id="intakes touch",
    ),
    pytest.param(a_giver_that_was_removed_half_way, Holding, "drop_removed", "is_removed(found.peer)", "False", id="removed peers dropped"),
    pytest.param(
        a_claim_by_a_giver_that_was_removed,
        Holding,
        "drop_removed",
        "is_removed(found.peer)",
        "False",
        id="removed peers claim nothing",
    ),
    pytest.param(a_piece_that_is_on_its_way, rules, "bound_for", "holding.is_open(side)", "False", id="open bounds are told"),
]


@pytest.mark.parametrize(("story", "owner", "name", "old", "new"), GUARDS)
def test_it_goes_well_with_the_safeguard_and_badly_without(
    monkeypatch: pytest.MonkeyPatch, story: Callable[[], None], owner: object, name: str, old: str, new: str
) -> None:
    story()
    bend(monkeypatch, owner, name, old, new)
    with pytest.raises(AssertionError):
        story()


def test_an_id_that_is_not_noted_claims_nothing() -> None:
    a_claim_of_a_handover_that_has_ended()
