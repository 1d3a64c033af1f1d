"""If this fails, the judge expects copies where nobody puts them, or seeds keep them all alike."""

from __future__ import annotations

from collections import Counter

from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.ids import NodeId
from scenefold.base.location import LINE_LENGTH, Arc, Location
from scenefold.base.placement import Line, holders_at
from scenefold.base.prefixes import address_prefix, forbids
from scenefold.scene.log import free_offsets
from scenefold.simulation.copying import Copying, Rule, address_of_slot, draw_copying, holders, rack


@given(st.data())
def test_the_judge_and_nodes_put_copies_in_the_same_places(data: st.DataObject) -> None:
    bounds = sorted(data.draw(st.sets(st.integers(1, LINE_LENGTH - 1), max_size=6)))
    arcs = {
        NodeId((10 << 24) + (number % 3 << 16) + number): Arc(Location.from_number(first), Location.from_number(behind - 1))
        for number, (first, behind) in enumerate(zip([0, *bounds], [*bounds, LINE_LENGTH], strict=True))
    }
    layout = tuple(free_offsets([], data.draw(st.integers(0, 4))))
    home = Location.from_number(data.draw(st.sampled_from([0, *bounds]) | st.integers(0, LINE_LENGTH - 1)))
    owner = next(node for node in arcs if home in arcs[node])
    prefixes = (address_prefix(Copying(3, 2, 3).prefix_of(data.draw(st.integers(0, 2)))),)
    waiting = [NodeId((10 << 24) + (number % 3 << 16) + 100 + number) for number in range(data.draw(st.integers(0, 3)))]
    forbidden = [node for node in [*arcs, *waiting] if forbids(prefixes, node, owner=owner)]
    line, needed = Line([*arcs.items(), *((node, None) for node in waiting)]), data.draw(st.integers(1, 4))
    expected = holders_at(line, owner, forbidden, layout, home, needed - 1)
    assert holders(Rule(layout, needed), home, owner, arcs, prefixes, waiting) == expected


def test_seeds_differ_and_most_keep_three_copies_of_which_two_count() -> None:
    found = Counter((draw_copying(seed).copies, draw_copying(seed).least) for seed in range(300))
    assert set(found) == {(3, 1), (3, 2), (3, 3), (2, 2)} and found[3, 2] > 120
    assert {draw_copying(seed).racks for seed in range(100)} == {0, 2, 3}


def test_a_rack_is_what_its_prefix_covers() -> None:
    copying = Copying(3, 2, 3)
    for slot in range(9):
        mine = copying.prefix_of(slot).removesuffix("0.0/16")
        assert [other for other in range(9) if address_of_slot(other, 3).startswith(mine)] == list(rack(slot % 3, 3, 9))
    assert [address_of_slot(slot) for slot in (0, 255)] == ["10.0.0.1", "10.0.1.0"]
