"""If this fails, the judge of modes lets an edit into what is being rendered, or sees one where none is."""

from __future__ import annotations

import itertools

import pytest

from scenefold.base.location import FIRST
from scenefold.simulation import laws
from scenefold.simulation.history import Place, Version
from scenefold.simulation.lineage import Holder
from scenefold.simulation.log_frozen import Acting, Frozen
from scenefold.wire import SceneMode

PLACE = Place(1, 2, bytes(FIRST))
NODE, OTHER, ANEW = Holder(0, b"a" * 16), Holder(1, b"b" * 16), Holder(0, b"c" * 16)
SWITCHED, BACK = 5, 8


def version(epoch: int, name: bytes = b"x") -> Version:
    return Version((epoch, 1, 1, 1, name * 32), name * 32)


def frozen() -> Frozen:
    """Rendered from position 5 on, edited again from 8 on."""
    judge = Frozen(itertools.count(1).__next__)
    for position in range(1, 11):
        judge.decided(position, SceneMode.RENDER if SWITCHED <= position < BACK else SceneMode.EDIT)
    return judge


def laws_of(wrong: list[tuple[str, str]]) -> list[str]:
    return [law for law, _ in wrong]


def test_switches_are_where_the_mode_changes() -> None:
    assert frozen().switches == [SWITCHED, BACK]


@pytest.mark.parametrize(
    ("leased", "position", "is_wrong"),
    [(4, 4, False), (4, 5, True), (4, 7, True), (5, 7, False), (7, 8, True), (8, 7, False), (9, 10, False)],
)
def test_no_mode_is_active_that_was_switched_to_above_a_lease_in_use(leased: int, position: int, is_wrong: bool) -> None:
    wrong = frozen().acts("c0", "signs", leased, [Acting("n1", 3), Acting("n0", position)])
    assert laws_of(wrong) == [laws.MODES_APART] * is_wrong


def test_who_has_answered_a_reader_takes_nothing_of_before() -> None:
    judge = frozen()
    judge.came(NODE, PLACE, version(3))
    judge.fenced(NODE, SWITCHED)
    assert judge.taken(NODE, PLACE, version(3)) == [], "it came before the answer"
    judge.came(NODE, PLACE, version(4))
    judge.came(OTHER, PLACE, version(4))
    judge.came(ANEW, PLACE, version(4))
    assert laws_of(judge.taken(NODE, PLACE, version(4))) == [laws.FROZEN]
    assert judge.taken(OTHER, PLACE, version(4)) == [], "nobody has asked that one"
    assert judge.taken(ANEW, PLACE, version(4)) == [], "nor this one, since it began anew"


def test_what_is_signed_above_the_floor_is_taken() -> None:
    judge = frozen()
    judge.fenced(NODE, SWITCHED)
    judge.fenced(NODE, SWITCHED)
    judge.came(NODE, PLACE, version(BACK))
    assert judge.taken(NODE, PLACE, version(BACK)) == [] and judge.edits == {version(BACK).digest}


def test_a_floor_that_rises_counts_from_then_on() -> None:
    judge = frozen()
    judge.fenced(NODE, SWITCHED)
    judge.came(NODE, PLACE, version(6))
    judge.fenced(NODE, BACK)
    assert judge.taken(NODE, PLACE, version(6)) == []
    judge.came(NODE, PLACE, version(7))
    assert laws_of(judge.taken(NODE, PLACE, version(7))) == [laws.FROZEN]


def look(judge: Frozen, found: Version | None, *there: Version, floor: int = SWITCHED, owner: Holder = NODE) -> list[str]:
    return laws_of(judge.looked("c2", floor, PLACE, found, lambda: [each.digest for each in there], owner))


def test_all_who_render_at_one_position_read_the_same() -> None:
    judge = frozen()
    assert look(judge, version(3)) == look(judge, version(3)) == []
    assert look(judge, version(4, b"y")) == [laws.FROZEN]
    assert look(judge, version(6, b"y"), floor=BACK) == [], "at another position another one may lie there"
    assert judge.looks == 4


def test_nothing_becomes_something_only_if_it_lay_on_a_disk_before() -> None:
    judge = frozen()
    assert look(judge, None, version(4, b"y")) == []
    assert look(judge, version(4, b"y")) == [] and judge.moved == 1
    assert look(judge, version(4, b"z")) == [laws.FROZEN]


def test_another_owner_whom_nobody_had_asked_may_have_taken_more() -> None:
    judge = frozen()
    assert look(judge, version(3)) == []
    assert look(judge, version(4, b"y"), owner=OTHER) == [] and judge.moved == 1


def test_what_was_signed_in_render_mode_or_later_is_in_no_image() -> None:
    assert look(frozen(), version(SWITCHED)) == [laws.FROZEN]
