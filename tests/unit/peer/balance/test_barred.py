"""If this fails, balance gives places to nodes that can write nothing there, or takes every node for one of those."""

from __future__ import annotations

import pytest
import trio
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.ids import address_of
from scenefold.base.prefixes import ADDRESS_BITS, AddressPrefix, address_prefix, forbids
from scenefold.peer.balance.barred import barred
from scenefold.peer.balance.policy import BYTES_MIN, FILL_MAX, Give, NodeFill, gives, the_rest
from scenefold.peer.line.ends import Side
from unit.peer.balance.street import KIB, House, Street
from unit.peer.balance.test_hands import CHECK, MIB, ORDER, running, tell, until
from unit.peer.logs_made import node

EVERYBODY = (address_prefix("0.0.0.0/0"),)


def test_who_forbids_everybody_is_barred_and_who_leaves_enough_is_not() -> None:
    nodes = [node(number) for number in range(4)]
    lists = {nodes[1]: EVERYBODY, nodes[2]: (AddressPrefix(nodes[0], ADDRESS_BITS),)}
    assert barred(nodes, lists, 2) == {nodes[1]}
    assert barred(nodes, lists, 3) == {nodes[1]}
    assert barred(nodes, lists, 4) == {nodes[1], nodes[2]}
    assert barred(nodes, lists, 1) == frozenset()


def test_few_nodes_or_lists_that_bar_all_bar_nobody() -> None:
    nodes = [node(number) for number in range(2)]
    assert barred(nodes, {}, 3) == frozenset()
    assert barred(nodes[:1], {nodes[0]: EVERYBODY}, 3) == frozenset()
    assert barred(nodes, dict.fromkeys(nodes, EVERYBODY), 2) == frozenset()


PREFIXES = st.builds(
    lambda bits, number: AddressPrefix(node(number) >> bits << bits, ADDRESS_BITS - bits), st.integers(0, 3), st.integers(0, 7)
)


@given(st.dictionaries(st.integers(0, 7), st.lists(PREFIXES, max_size=3)), st.integers(1, 9))
def test_nobody_is_barred_who_has_the_holders(lists: dict[int, list[AddressPrefix]], needed: int) -> None:
    nodes = [node(number) for number in range(8)]
    blacklists = {node(number): tuple(listed) for number, listed in lists.items()}
    found = barred(nodes, blacklists, needed)
    for one in nodes:
        holders = sum(not forbids(blacklists.get(one, ()), other, owner=one) for other in nodes)
        is_short = holders < min(needed, len(nodes)) - 1
        assert (one in found) <= is_short
        assert one in found or not is_short or not found
    assert len(found) < len(nodes)


def test_who_shall_own_nothing_is_given_nothing_and_gives_all() -> None:
    line = [NodeFill(100 * BYTES_MIN, 1000 * BYTES_MIN), NodeFill(40 * BYTES_MIN, 0), NodeFill(0, 1000 * BYTES_MIN)]
    assert gives(line, 0) == []
    assert gives(line, 1) == [Give(Side.RIGHT, 39 * BYTES_MIN)]
    assert gives(line, 2) == []


def test_the_rest_goes_where_there_is_room() -> None:
    roomy, narrow, nothing = NodeFill(0, 10 * BYTES_MIN), NodeFill(0, 2 * BYTES_MIN), NodeFill(BYTES_MIN, 0)
    assert the_rest([narrow, nothing, roomy], 1) == [Give(Side.RIGHT, BYTES_MIN, is_rest=True)]
    assert the_rest([narrow, nothing], 1) == [Give(Side.LEFT, BYTES_MIN, is_rest=True)]
    assert the_rest([nothing, NodeFill(2 * BYTES_MIN, int(2 * BYTES_MIN / FILL_MAX))], 0) == []
    assert the_rest([nothing], 0) == []
    assert the_rest([NodeFill(0, 10 * BYTES_MIN, open=False), nothing], 1) == []


def street_of_three() -> tuple[Street, House, House, House]:
    street = Street([64 * MIB] * 3)
    street.needed = 2
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
        await until(street, lambda: abs(first.used - third.used) < 500 * KIB)
        second.forbid()
        await until(street, lambda: abs(second.used - 5000 * KIB / 3) < 250 * KIB)
    assert street.records() == everything


async def test_a_newcomer_that_forbids_everybody_is_given_one_location(autojump_clock: trio.testing.MockClock) -> None:
    street = Street([64 * MIB] * 2)
    street.needed = 2
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
        await tell(third, ORDER)
        await trio.sleep(60)
        assert third.used == 500 * KIB
        report = await tell(third, CHECK)
        assert f"the blacklist of {address_of(second.me)} leaves it too few holders" in str(report["text"])
        second.forbid()
        await until(street, lambda: not third.alive)
    assert first.used + second.used == 500 * KIB


@pytest.mark.parametrize("needed", [1, 2, 3])
async def test_where_all_forbid_everybody_they_balance_as_ever(autojump_clock: trio.testing.MockClock, needed: int) -> None:
    street, first, second, third = street_of_three()
    street.needed = needed
    first.fill_evenly(90, 50 * KIB)
    for house in (first, second, third):
        house.forbid("0.0.0.0/0")
    async with running(street):
        await until(street, lambda: all(abs(house.used - 1500 * KIB) < 250 * KIB for house in street.houses))
