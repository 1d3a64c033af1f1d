"""Prefixes of IPv4 addresses, and the blacklists that consist of them (specs/20-copies.md, Blacklists).

A node's id is its address, so a prefix names all nodes of a room or a rack, also those that come later. Pure.
"""

from __future__ import annotations

import ipaddress
from collections.abc import Iterable
from typing import NamedTuple

from scenefold.base.ids import NodeId, checked_node_id

ADDRESS_BITS = 32


class AddressPrefix(NamedTuple):
    """All addresses that begin with the first `bits` bits of `address`, whose others are 0."""

    address: int
    bits: int

    def __str__(self) -> str:
        """As people write it: one address has no slash."""
        text = str(ipaddress.IPv4Address(self.address))
        return text if self.bits == ADDRESS_BITS else f"{text}/{self.bits}"

    def covers(self, node: NodeId) -> bool:
        """Whether the node's address lies in it."""
        return (node ^ self.address) >> (ADDRESS_BITS - self.bits) == 0


class Blacklist(NamedTuple):
    """Which nodes an owner wants no copies on, itself aside. The version rises with each change."""

    version: int = 0
    prefixes: tuple[AddressPrefix, ...] = ()


def address_prefix(text: str) -> AddressPrefix:
    """The prefix that a person has written, such as 10.1.2.0/24, or one address; ValueError, in words, if it is neither."""
    address, slash, bits = text.partition("/")
    if not slash:
        return AddressPrefix(checked_node_id(address), ADDRESS_BITS)
    # ipaddress would take masks as well, and numbers with zeros before them.
    if bits not in map(str, range(ADDRESS_BITS + 1)):
        raise ValueError(f"{text!r} is no address prefix: a number from 0 to {ADDRESS_BITS} belongs behind the slash")
    try:
        known = ipaddress.IPv4Interface(text)
    except ValueError:
        raise ValueError(f"{text!r} is no address prefix: {address!r} is no IPv4 address") from None
    if known.ip != known.network.network_address:
        raise ValueError(f"{text} has bits set behind the first {bits}: the prefix is {known.network}")
    return AddressPrefix(int(known.ip), int(bits))


def forbids(blacklist: Iterable[AddressPrefix], node: NodeId, *, owner: NodeId) -> bool:
    """Whether `node` must hold no copies of what `owner` owns, whose blacklist this is. It is on its own one always."""
    return node == owner or any(prefix.covers(node) for prefix in blacklist)
