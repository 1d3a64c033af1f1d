"""If one fails, what is asked for each answer of a holder is not what the segment says."""

from __future__ import annotations

from itertools import combinations

import hypothesis.strategies as st
from hypothesis import given

from scenefold.base.ids import NodeId
from scenefold.base.location import WHOLE_LINE, Location
from scenefold.peer.copies.configurations import Configurations
from scenefold.peer.copies.copies import Copies
from scenefold.peer.replication.settling_rule import Rule, Rules
from scenefold.wire import Member

LAYOUT = (Location.from_number(7), Location.from_number(8))
ME, *OTHERS = (Member(NodeId(node), bytes([node]) * 16) for node in range(1, 6))
EVERYBODY = [frozenset(some) | {ME} for size in range(5) for some in combinations(OTHERS, size)]

members = st.sampled_from(OTHERS)
acts = st.one_of(
    st.tuples(st.just("place"), st.lists(members, min_size=1, max_size=2, unique=True).map(tuple), st.integers(1, 3)),
    st.tuples(st.just("tell"), members, st.just(0)),
    st.tuples(st.just("compare"), members, st.just(0)),
    st.tuples(st.just("activate"), members, st.just(0)),
    st.tuples(st.just("remove"), members, st.just(0)),
)


def after(found: Configurations, act: str, what: object, needed: int) -> Configurations:
    match act:
        case "place":
            assert isinstance(what, tuple)
            return found.place(LAYOUT, [(WHOLE_LINE, what)], needed)
        case "tell":
            for word in found.untold():
                found = found.confirm(word) if word.holder == what else found
            return found
        case "compare":
            assert isinstance(what, Member)
            entries = [entry for segment in found.segments if (entry := segment.wanted(what, ME)) is not None]
            for entry in entries:
                found = found.compare(what, entry)
            return found
        case "activate":
            return found.activate(lambda _: ())
        case _:
            assert isinstance(what, Member)
            return found.remove(what)


@given(st.lists(acts, max_size=14), st.integers(1, 3))
def test_the_rule_says_what_the_segment_says_and_of_its_next_configuration_what_that_will_ask(
    story: list[tuple[str, object, int]], needed: int
) -> None:
    found = Configurations(ME)
    for act, what, least in story:
        found = after(found, act, what, least)
        for segment in found.segments:
            rule = Rule.of(segment, ME)
            change = segment.change
            is_ready = change is not None and segment.sound.issuperset(change.holders)
            for have in EVERYBODY:
                is_settled = rule.is_settled(have, needed)
                assert segment.is_settled(have, needed, ME) or not is_settled
                assert is_ready or is_settled == segment.is_settled(have, needed, ME)
                if is_settled and is_ready:
                    (active,) = found.activate(lambda _: ()).segments
                    assert active.is_settled(have, 0, ME), "whoever answers by the next configuration has it"


def test_rules_are_made_once() -> None:
    found = Configurations(ME).place(LAYOUT, [(WHOLE_LINE, (OTHERS[0], OTHERS[1]))], 2)
    (segment,) = found.segments
    rules = Rules(Copies(found))
    assert rules.of(segment) is rules.of(segment)
    assert rules.of(segment).debtors == (OTHERS[0].node, OTHERS[1].node)
    assert rules.of(segment).is_placed
    later = Rules(Copies(found), rules)
    assert later.of(segment) is rules.of(segment)
    (other,) = found.place(LAYOUT, [(WHOLE_LINE, (OTHERS[0],))], 2).segments
    assert later.of(other) is not rules.of(segment)
