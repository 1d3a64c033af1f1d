"""If this fails, balance gives places to nodes that can write nothing there, or takes every node for one of those."""

from __future__ import annotations

import trio
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.ids import address_of
from scenefold.base.location import LAST
from scenefold.base.prefixes import ADDRESS_BITS, AddressPrefix, address_prefix, forbids
from scenefold.peer.balance.barred import BARRED_REST_S, barred
from scenefold.peer.balance.policy import BYTES_MIN, FILL_MAX, Give, NodeFill, the_rest
from scenefold.peer.line.ends import Side
from unit.peer.balance.street import KIB, House, Street
from unit.peer.balance.test_hands import CHECK, MIB, ORDER, running, tell, until
from unit.peer.logs_made import node

EVERYBODY = (address_prefix("0.0.0.0/0"),)


def test_who_allows_nobody_is_barred_and_who_allows_one_is_not() -> None:
    nodes = [node(number) for number in range(4)]
    one, but_one = AddressPrefix(nodes[0], ADDRESS_BITS), [AddressPrefix(other, ADDRESS_BITS) for other in nodes if other != nodes[3]]
    assert barred(nodes, {nodes[1]: EVERYBODY, nodes[2]: (one,)}) == {nodes[1]}
    assert barred(nodes, {nodes[3]: but_one, nodes[2]: but_one[1:]}) == {nodes[3]}
    assert barred(nodes, {}) == frozenset()
    assert barred(nodes[:1], {nodes[0]: EVERYBODY}) == frozenset(), "there is nobody whom it could allow"


PREFIXES = st.builds(
    lambda bits, number: AddressPrefix(node(number) >> bits << bits, ADDRESS_BITS - bits), st.integers(0, 3), st.integers(0, 7)
)


@given(st.dictionaries(st.integers(0, 7), st.lists(PREFIXES, max_size=3)), st.integers(2, 8))
def test_nobody_is_barred_who_has_a_holder_and_everybody_who_has_none(lists: dict[int, list[AddressPrefix]], count: int) -> None:
    nodes = [node(number) for number in range(count)]
    blacklists = {node(number): tuple(listed) for number, listed in lists.items()}
    found = barred(nodes, blacklists)
    assert found == {one for one in nodes if all(forbids(blacklists.get(one, ()), other, owner=one) for other in nodes)}


def test_all_goes_where_there_is_room() -> None:
    roomy, narrow, nothing = NodeFill(0, 10 * BYTES_MIN), NodeFill(0, 2 * BYTES_MIN), NodeFill(5 * BYTES_MIN, 1000 * BYTES_MIN)
    right, left = Give(Side.RIGHT, 5 * BYTES_MIN, is_rest=True), Give(Side.LEFT, int(FILL_MAX * 2 * BYTES_MIN), is_rest=True)
    assert the_rest([narrow, nothing, roomy], 1) == [right, left]
    assert the_rest([narrow, nothing], 1) == [left]
    assert the_rest([nothing, NodeFill(2 * BYTES_MIN, int(2 * BYTES_MIN / FILL_MAX))], 0) == []
    assert the_rest([nothing], 0) == []
    assert the_rest([NodeFill(0, 10 * BYTES_MIN, open=False), nothing], 1) == []


def street_of_three() -> tuple[Street, House, House, House]:
    street = Street([64 * MIB] * 3)
    first, second, third = street.houses
    return street, first, second, third


async def test_a_loaded_node_gives_nothing_to_one_that_could_not_write_it(autojump_clock: trio.testing.MockClock) -> None:
    street, first, second, third = street_of_three()
    first.fill_evenly(100, 50 * KIB)
    second.forbid("0.0.0.0/0")
    async with running(street):
        await until(street, lambda: second.arc is not None and second.arc.length == 1)
        await trio.sleep(60)
        street.check()
    assert first.used == 5000 * KIB
    assert third.used == 0


async def test_who_comes_to_forbid_everybody_gives_all_it_has_and_gets_it_back_later(autojump_clock: trio.testing.MockClock) -> None:
    street, first, second, third = street_of_three()
    second.fill_evenly(100, 50 * KIB)
    everything = street.records()
    second.forbid("0.0.0.0/0")
    async with running(street):
        await until(street, lambda: not second.used and second.arc is not None and second.arc.length == 1)
        assert street.records() == everything
        assert first.used + third.used == 5000 * KIB
        second.forbid()
        await until(street, lambda: abs(second.used - 5000 * KIB / 3) < 250 * KIB)
    assert street.records() == everything


async def test_a_newcomer_that_forbids_everybody_is_given_one_location(autojump_clock: trio.testing.MockClock) -> None:
    street = Street([64 * MIB] * 2)
    street.houses[0].fill_evenly(100, 50 * KIB)
    newcomer = street.add_newcomer(64 * MIB)
    newcomer.forbid("0.0.0.0/0")
    async with running(street):
        await newcomer.joining.join()
        await until(street, lambda: newcomer.arc is not None)
        await trio.sleep(60)
        street.check()
    assert newcomer.arc is not None
    assert newcomer.arc.length == 1


async def test_a_leaving_node_passes_by_who_forbids_everybody(autojump_clock: trio.testing.MockClock) -> None:
    street, first, second, third = street_of_three()
    fourth = street.add_newcomer(64 * MIB)
    second.fill_evenly(10, 50 * KIB)
    third.forbid("0.0.0.0/0")
    async with running(street):
        await fourth.joining.join()
        await until(street, lambda: fourth.arc is not None)
        await tell(second, ORDER)
        await until(street, lambda: not second.alive)
    assert third.used == 0
    assert sum(house.used for house in (first, fourth)) == 500 * KIB


async def test_a_leaving_node_says_whose_blacklist_keeps_it(autojump_clock: trio.testing.MockClock) -> None:
    street, first, second, third = street_of_three()
    third.fill_evenly(10, 50 * KIB)
    second.forbid("0.0.0.0/0")
    async with running(street):
        await trio.sleep(5)
        assert f"the blacklist of {address_of(second.me)}" in str((await tell(third, CHECK))["text"]), "known beforehand"
        await tell(third, ORDER)
        await trio.sleep(60)
        assert third.used == 500 * KIB
        report = await tell(third, CHECK)
        assert report["room_bytes"] == 0
        assert f"the blacklist of {address_of(second.me)} allows no other node to hold copies" in str(report["text"])
        second.forbid()
        await until(street, lambda: not third.alive)
    assert first.used + second.used == 500 * KIB


async def test_where_all_forbid_everybody_nothing_moves(autojump_clock: trio.testing.MockClock) -> None:
    """Who holds copies by what was allowed before keeps them; whoever owned the place next could have none."""
    street, first, second, third = street_of_three()
    first.fill_evenly(90, 50 * KIB)
    for house in (first, second, third):
        house.forbid("0.0.0.0/0")
    async with running(street):
        await trio.sleep(300)
        street.check()
    assert street.handovers == 0


async def test_a_slip_of_the_hand_that_is_taken_back_moves_nothing(autojump_clock: trio.testing.MockClock) -> None:
    street, first, second, third = street_of_three()
    for house in (first, second, third):
        house.fill_evenly(50, 50 * KIB)
    async with running(street):
        for _ in range(3):
            second.forbid("0.0.0.0/0")
            await trio.sleep(BARRED_REST_S - 5)
            second.forbid()
            await trio.sleep(20)
    assert street.handovers == 0


async def test_who_is_barred_cuts_the_line_and_both_sides_are_even_by_themselves(autojump_clock: trio.testing.MockClock) -> None:
    street = Street([64 * MIB] * 5)
    first, second, third, fourth, fifth = street.houses
    for house in (first, second):
        house.fill_evenly(50 if house is first else 100, 50 * KIB)
    fourth.fill_evenly(60, 50 * KIB)
    third.forbid("0.0.0.0/0")
    async with running(street):
        await until(street, lambda: abs(first.used - second.used) < 300 * KIB and abs(fourth.used - fifth.used) < 300 * KIB)
        handovers = street.handovers
        await trio.sleep(300)
        street.check()
    assert first.used + second.used == 7500 * KIB and fourth.used + fifth.used == 3000 * KIB
    assert street.handovers - handovers <= 2, "the arc of who is barred, and what was under way"


async def test_the_location_that_is_kept_holds_no_record_where_that_can_be(autojump_clock: trio.testing.MockClock) -> None:
    street, first, second, third = street_of_three()
    assert second.arc is not None
    second.sizes = {second.arc.first: 50 * KIB}
    third.sizes = {LAST: 900 * KIB}
    first.sizes = {}
    second.forbid("0.0.0.0/0")
    async with running(street):
        await until(street, lambda: second.arc is not None and second.arc.length == 1)
    assert not second.sizes
