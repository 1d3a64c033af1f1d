"""If one fails, a cluster is called healthy while copies are missing, or sick while bounds move."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import hypothesis.strategies as st
from hypothesis import given

from scenefold.base.ids import NodeId
from scenefold.base.prefixes import AddressPrefix, address_prefix
from scenefold.peer.copies.configurations import Configurations
from scenefold.peer.copies.copies import Copies
from scenefold.peer.replication.standing import Lacking, Standing, by_layout, standing_of
from scenefold.wire import Member
from unit.peer.copies.test_configurations import ONE, TWO, A, B, C, D, P, Q, arc, changed, compare, tell

WHOLE = arc(0, 99)


def all_but(*silent: NodeId) -> Callable[[Member], bool]:
    return lambda member: member.node not in silent


def standing(found: Configurations, *silent: NodeId, **more: object) -> Standing:
    changes: dict[str, object] = {"arc": WHOLE, "layouts": [ONE], "is_there": all_but(*silent), **more}
    return standing_of(Copies(found), **changes)  # type: ignore[arg-type]


def test_what_has_all_its_copies_on_nodes_that_answer_is_in_order() -> None:
    assert standing(changed(Configurations(P), A, B)) == Standing(segments=1)


def test_a_copy_on_a_node_that_does_not_answer_does_not_count() -> None:
    found = changed(Configurations(P), A, B)
    assert standing(found, B.node).lacking == (Lacking(ONE, WHOLE, 1),)
    assert standing(found, A.node, B.node).copies_missing_max == 2


def test_nor_does_one_that_is_being_filled_nor_one_whose_node_was_removed() -> None:
    found = tell(Configurations(P).place(ONE, [(WHOLE, (A, B))], 2))
    assert standing(found).copies_missing_max == 2
    assert standing(compare(found, B)).copies_missing_max == 1
    found = changed(Configurations(P), A, B).remove(B).place(ONE, [(WHOLE, (A, C))], 2)
    assert standing(found).lacking == (Lacking(ONE, WHOLE, 1),)
    assert standing(compare(tell(found))).lacking == (), "C is complete: that this is not told to everybody yet costs no copy"


def test_copies_that_lie_where_they_belonged_before_are_missing_nowhere() -> None:
    found = tell(changed(Configurations(P), A, B).place(ONE, [(arc(0, 49), (C, D))], 2))
    assert (standing(found).lacking, standing(found).moving) == ((), ((ONE, arc(0, 49)),))
    assert standing(changed(found, C, D, where=arc(0, 49))).moving == ()


def test_what_was_inherited_is_being_compared_as_long_as_nobody_is_missing() -> None:
    _, number, segments = changed(Configurations(Q), A, B).give(WHOLE)
    found = Configurations(P).take(number, segments)
    assert (standing(found).lacking, standing(found).comparing) == ((), ((ONE, WHOLE),))
    assert standing(found, A.node, B.node).lacking == (Lacking(ONE, WHOLE, 1),), "the former owner has it all"
    placed = tell(found.place(ONE, [(WHOLE, (A, B))], 2))
    assert standing(placed).comparing == ((ONE, WHOLE),)
    assert standing(compare(placed)) == Standing(segments=1)


def test_where_nobody_was_placed_all_copies_are_missing_and_gaps_are_left_out() -> None:
    found = changed(Configurations(P), A, B, where=arc(0, 49))
    assert standing(found).lacking == (Lacking(ONE, arc(50, 99), 2),)
    assert standing(found, layouts=[ONE, TWO]).lacking == (Lacking(ONE, arc(50, 99), 2), Lacking(TWO, WHOLE, 1))
    copies = replace(Copies(found), unrecovered=(arc(60, 99),))
    assert standing_of(copies, WHOLE, [ONE], all_but()).lacking == (Lacking(ONE, arc(50, 59), 2),)
    assert standing(found, arc=None).lacking == ()
    assert standing(found, layouts=[()]).lacking == (), "of a layout that nothing has any more nothing is asked"


def test_a_holder_that_the_blacklist_covers_is_told_apart() -> None:
    found = changed(Configurations(P), A, B)
    told = standing(found, blacklist=[AddressPrefix(A.node, 32)])
    assert (told.forbidden, told.forbidden_on) == (((ONE, WHOLE),), (A.node,))
    assert standing(found, blacklist=[address_prefix("10.0.0.0/8")]).forbidden == ()


@given(st.lists(st.lists(st.sampled_from([A, B, C, D]), min_size=2, max_size=2, unique=True), min_size=10, max_size=10), st.data())
def test_each_place_lacks_as_many_as_do_not_answer(holders: list[list[object]], data: st.DataObject) -> None:
    found = Configurations(P)
    for index, pair in enumerate(holders):
        found = changed(found, *pair, where=arc(10 * index, 10 * index + 9))  # type: ignore[arg-type]
    silent = data.draw(st.sets(st.sampled_from([A.node, B.node, C.node, D.node])))
    told = standing(found, *silent)
    for index, pair in enumerate(holders):
        missing = sum(member.node in silent for member in pair)  # type: ignore[attr-defined]
        place = arc(10 * index, 10 * index).first
        assert [one.missing for one in told.lacking if place in one.arc] == ([missing] if missing else [])
    assert all(left.arc.last < right.arc.first for left, right in zip(told.lacking, told.lacking[1:], strict=False))
    assert sum(map(len, by_layout((one.layout, one.arc) for one in told.lacking).values())) <= len(told.lacking)
