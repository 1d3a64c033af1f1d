"""If one fails, a holding is read back as another one, a late packet is believed, or an end of an arc is given that is none."""

from __future__ import annotations

import pytest

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.ids import NodeId
from scenefold.base.location import WHOLE_LINE, Arc
from scenefold.base.reasons import RejectReason
from scenefold.peer.line.ends import Side, without
from scenefold.peer.line.holding import Holding, handover_id
from scenefold.peer.line.holding_note import decode_holding, encode_holding
from scenefold.wire import Member, pack_value, unpack_value
from unit.peer.line.line_nodes import arc_of_cells

LEFT, RIGHT = Member(NodeId(1), b"l" * 16), Member(NodeId(3), b"r" * 16)
SALT = b"s" * 8


def nobody(_member: Member) -> bool:
    return False


def middle() -> Holding:
    """Owns cells 4 to 11, gives two to the right, and has noted two from the left."""
    owner = Holding().found(arc_of_cells(4, 11))
    owner = owner.offer(handover_id(owner.revision + 1, SALT), Side.RIGHT, RIGHT, arc_of_cells(10, 11))
    return owner.note(handover_id(7, SALT), Side.LEFT, LEFT, arc_of_cells(2, 3))


def test_a_holding_survives_its_note() -> None:
    assert decode_holding(encode_holding(middle())) == middle()
    assert decode_holding(encode_holding(Holding())) == Holding()


def test_an_arc_that_went_and_came_back_is_another_object_though_it_is_equal() -> None:
    """Who looks into the store tells by it that the arc was theirs all the time. An empty node has the piece itself as its arc."""
    owner = Holding().found(arc_of_cells(4, 11))
    assert owner.arc is not None
    identity = handover_id(owner.revision + 1, SALT)
    released = owner.offer(identity, Side.RIGHT, RIGHT, owner.arc).release(identity)
    back = released.take_back(identity, lambda _member: True)
    assert back.arc == owner.arc and back.arc is not owner.arc


@pytest.mark.parametrize(
    ("key", "value"),
    [("v", 2), ("revision", -1), ("arc", [b"", b""]), ("left", [b"x"]), ("heard", [[1, b"short", 1]]), ("arc", None), ("more", 1)],
)
def test_a_note_that_nobody_wrote_is_damaged(key: str, value: object) -> None:
    note = {**unpack_value(encode_holding(middle())), key: value}
    with pytest.raises(DamagedData):
        decode_holding(pack_value(note))
    with pytest.raises(DamagedData):
        decode_holding(encode_holding(middle())[:-1])


def test_a_late_offer_is_refused_once_a_later_one_was_taken() -> None:
    noted = middle()
    assert noted.left is not None
    ended = noted.drop(noted.left.id)
    for number in (6, 7):
        with pytest.raises(Refused) as refusal:
            ended.note(handover_id(number, SALT), Side.LEFT, LEFT, arc_of_cells(2, 3))
        assert refusal.value.reason is RejectReason.STALE_VERSION
    assert ended.note(handover_id(8, SALT), Side.LEFT, LEFT, arc_of_cells(2, 3)).left is not None


def test_only_an_end_of_the_arc_can_be_given_and_only_once_a_side() -> None:
    owner = Holding().found(arc_of_cells(4, 11))
    for piece, side in ((arc_of_cells(5, 6), Side.LEFT), (arc_of_cells(4, 5), Side.RIGHT), (arc_of_cells(11, 12), Side.RIGHT)):
        with pytest.raises(Refused):
            owner.offer(handover_id(owner.revision + 1, SALT), side, RIGHT, piece)
    with pytest.raises(Refused):
        middle().offer(handover_id(middle().revision + 1, SALT), Side.RIGHT, RIGHT, arc_of_cells(11, 11))


def test_each_step_may_be_repeated() -> None:
    holding = middle()
    assert holding.left is not None
    assert holding.right is not None
    taken = holding.claim(holding.left.id, arc_of_cells(2, 3))
    assert taken.arc == arc_of_cells(2, 11)
    assert taken.claim(holding.left.id, arc_of_cells(2, 3)) == taken
    released = taken.release(holding.right.id)
    assert released.arc == arc_of_cells(2, 9)
    assert released.release(holding.right.id) == released
    given = released.confirm(holding.right.id, nobody)
    assert given.confirm(holding.right.id, nobody) == given
    done = given.finish(holding.right.id).drop(holding.left.id)
    assert done.finish(holding.right.id).drop(holding.left.id) == done
    assert done.handovers == []


def test_what_was_released_cannot_be_withdrawn_nor_claimed_back() -> None:
    holding = middle()
    assert holding.right is not None
    released = holding.release(holding.right.id)
    for transition in (released.withdraw, released.drop):
        with pytest.raises(Refused):
            transition(holding.right.id)
    with pytest.raises(Refused):
        released.claim(holding.right.id, arc_of_cells(10, 11))


def removed(_member: Member) -> bool:
    return True


@pytest.mark.parametrize("order", [(Side.LEFT, Side.RIGHT), (Side.RIGHT, Side.LEFT)])
@pytest.mark.parametrize("whole", [True, False])
def test_what_was_released_to_removed_nodes_on_both_sides_comes_back(order: tuple[Side, Side], whole: bool) -> None:
    before = Holding().found(arc_of_cells(4, 11))
    pieces = {Side.LEFT: arc_of_cells(4, 7), Side.RIGHT: arc_of_cells(8 if whole else 10, 11)}
    holding = before
    for side, peer in ((Side.LEFT, LEFT), (Side.RIGHT, RIGHT)):
        identity = handover_id(holding.revision + 1, SALT)
        holding = holding.offer(identity, side, peer, pieces[side]).release(identity)
    assert holding.arc == (None if whole else arc_of_cells(8, 9))
    assert holding.drop_removed(removed) == holding
    for side in order:
        known = holding.on(side)
        assert known is not None
        with pytest.raises(Refused):
            holding.take_back(known.id, nobody)
        with pytest.raises(Refused):
            holding.confirm(known.id, removed)
        assert holding.is_open(side)
        holding = decode_holding(encode_holding(holding.take_back(known.id, removed)))
        assert holding.take_back(known.id, removed) == holding
    assert holding.arc == before.arc
    assert holding.handovers == []


def test_only_what_was_released_is_taken_back() -> None:
    holding = middle()
    assert holding.right is not None
    assert holding.left is not None
    for identity in (holding.right.id, holding.left.id):
        with pytest.raises(Refused):
            holding.take_back(identity, removed)
    given = holding.release(holding.right.id).confirm(holding.right.id, nobody)
    with pytest.raises(Refused):
        given.take_back(holding.right.id, removed)
    assert given.drop_removed(removed).handovers == []


def test_what_was_taken_is_offered_to_nobody_until_its_giver_has_ended_the_handover() -> None:
    holding = middle().withdraw(handover_id(2, SALT))
    assert holding.left is not None
    taken = holding.claim(holding.left.id, arc_of_cells(2, 3))
    for first in (2, 3):
        with pytest.raises(Refused) as refusal:
            taken.offer(handover_id(taken.revision + 1, SALT), Side.RIGHT, RIGHT, arc_of_cells(first, 11))
        assert refusal.value.reason is RejectReason.BUSY
    assert taken.offer(handover_id(taken.revision + 1, SALT), Side.RIGHT, RIGHT, arc_of_cells(4, 11)).right is not None
    ended = taken.drop(holding.left.id)
    assert ended.offer(handover_id(ended.revision + 1, SALT), Side.RIGHT, RIGHT, arc_of_cells(2, 11)).right is not None


def test_a_gap_is_adopted_only_as_it_was_surveyed_and_beside_nothing_open() -> None:
    holding = middle()
    with pytest.raises(Refused):
        holding.adopt(arc_of_cells(0, 3), revision=holding.revision)
    owner = Holding().found(arc_of_cells(4, 11))
    with pytest.raises(Refused):
        owner.adopt(arc_of_cells(0, 3), revision=owner.revision - 1)
    assert owner.adopt(arc_of_cells(0, 3), revision=owner.revision).arc == arc_of_cells(0, 11)
    assert Holding().adopt(WHOLE_LINE, revision=0).arc == WHOLE_LINE


def test_an_arc_without_all_of_itself_is_none() -> None:
    arc = arc_of_cells(4, 11)
    assert without(arc, arc, Side.LEFT) is None
    assert without(arc, Arc(arc.first, arc.first), Side.LEFT) is not None
