"""If this fails, a blacklist forbids other nodes than the administrator named, and copies lie where they must not."""

from __future__ import annotations

import ipaddress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.ids import NodeId, address_of, node_id_of
from scenefold.base.prefixes import AddressPrefix, address_prefix, forbids

NUMBERS = st.integers(0, 2**32 - 1)


@given(NUMBERS, st.integers(0, 32), NUMBERS)
def test_a_prefix_covers_what_its_network_holds(number: int, bits: int, node: int) -> None:
    network = ipaddress.IPv4Network((number, bits), strict=False)
    prefix = AddressPrefix(int(network.network_address), bits)
    assert prefix.covers(NodeId(node)) == (ipaddress.IPv4Address(node) in network)
    assert prefix.covers(NodeId(number))


@given(NUMBERS, st.integers(0, 31))
def test_a_prefix_is_read_as_it_is_shown(number: int, bits: int) -> None:
    prefix = AddressPrefix(number >> (32 - bits) << (32 - bits), bits)
    assert address_prefix(str(prefix)) == prefix


def test_one_address_is_a_prefix_of_all_its_bits() -> None:
    assert address_prefix("10.1.2.3") == address_prefix("10.1.2.3/32") == AddressPrefix(node_id_of("10.1.2.3"), 32)
    assert str(address_prefix("10.1.2.3/32")) == "10.1.2.3"


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("ada", "'ada' is no IPv4 address"),
        ("", "'' is no IPv4 address"),
        ("0.0.0.0", "0.0.0.0 is not the address of one machine"),
        ("ada/8", "'ada/8' is no address prefix: 'ada' is no IPv4 address"),
        ("10.0.0/8", "'10.0.0/8' is no address prefix: '10.0.0' is no IPv4 address"),
        ("fe80::/10", "'fe80::/10' is no address prefix: 'fe80::' is no IPv4 address"),
        ("10.0.0.0/", "'10.0.0.0/' is no address prefix: a number from 0 to 32 belongs behind the slash"),
        ("10.0.0.0/33", "'10.0.0.0/33' is no address prefix: a number from 0 to 32 belongs behind the slash"),
        ("10.0.0.0/08", "'10.0.0.0/08' is no address prefix: a number from 0 to 32 belongs behind the slash"),
        ("10.0.0.0/-8", "'10.0.0.0/-8' is no address prefix: a number from 0 to 32 belongs behind the slash"),
        ("10.0.0.0/255.0.0.0", "'10.0.0.0/255.0.0.0' is no address prefix: a number from 0 to 32 belongs behind the slash"),
        ("10.1.2.3/24", "10.1.2.3/24 has bits set behind the first 24: the prefix is 10.1.2.0/24"),
        ("128.0.0.0/0", "128.0.0.0/0 has bits set behind the first 0: the prefix is 0.0.0.0/0"),
    ],
)
def test_what_is_no_prefix_is_one_clear_sentence(text: str, problem: str) -> None:
    with pytest.raises(ValueError) as caught:
        address_prefix(text)
    assert str(caught.value) == problem


def test_an_owner_is_on_its_own_blacklist_always() -> None:
    owner = node_id_of("10.1.1.1")
    rack = [address_prefix("10.1.2.0/24"), address_prefix("10.9.9.9")]
    asked = ("10.1.1.1", "10.1.1.2", "10.1.2.0", "10.1.2.255", "10.1.3.0", "10.9.9.9")
    assert [address_of(node) for node in map(node_id_of, asked) if forbids(rack, node, owner=owner)] == [
        "10.1.1.1",
        "10.1.2.0",
        "10.1.2.255",
        "10.9.9.9",
    ]
    assert forbids([], owner, owner=owner) and not forbids([], node_id_of("10.1.1.2"), owner=owner)
    assert forbids([address_prefix("0.0.0.0/0")], node_id_of("192.168.1.1"), owner=owner)
