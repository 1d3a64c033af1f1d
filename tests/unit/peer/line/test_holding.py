"""If one fails, a holding is read back as another one, a late packet is believed, or an end of an arc is given that is none."""

from __future__ import annotations

import pytest

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.ids import NodeId
from scenefold.base.location import WHOLE_LINE, Arc
from scenefold.base.reasons import RejectReason
from scenefold.peer.line.holding import Holding, Side, handover_id, without
from scenefold.peer.line.holding_note import decode_holding, encode_holding
from scenefold.wire import Member, pack_value, unpack_value
from unit.peer.line.line_nodes import arc_of_cells

LEFT, RIGHT = Member(NodeId(1), b"l" * 16), Member(NodeId(3), b"r" * 16)
SALT = b"s" * 8


def middle() -> Holding:
    """Owns cells 4 to 11, gives two to the right, and has noted two from the left."""
    owner = Holding().found(arc_of_cells(4, 11))
    owner = owner.offer(handover_id(owner.revision + 1, SALT), Side.RIGHT, RIGHT, arc_of_cells(10, 11))
    return owner.note(handover_id(7, SALT), Side.LEFT, LEFT, arc_of_cells(2, 3))


def test_a_holding_survives_its_note() -> None:
    assert decode_holding(encode_holding(middle())) == middle()
    assert decode_holding(encode_holding(Holding())) == Holding()


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
    given = released.confirm(holding.right.id)
    assert given.confirm(holding.right.id) == given
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
