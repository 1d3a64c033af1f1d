"""Identifiers of Appendix C: nodes, scenes, spaces. A node's id is its IPv4 address as a number."""

from __future__ import annotations

import ipaddress
from functools import lru_cache
from typing import NewType

NodeId = NewType("NodeId", int)
"""32 bits, unsigned; by default the node's IPv4 address."""
SceneId = NewType("SceneId", int)
"""32 bits, unsigned; the first 32 bits of the scene's genesis hash. 0 is no scene."""
SpaceId = NewType("SpaceId", int)
"""13 bits: 1 to 8191."""
KeyId = NewType("KeyId", int)
"""32 bits: the first 32 bits of the SHA-256 of a public key."""

SPACE_ID_MAX = 8191
REMEMBERED_MAX = 4096
"""Addresses and ids: those of a large cluster. They are asked for several times a packet."""
_UNSPECIFIED = ipaddress.IPv4Network("0.0.0.0/8")
_BROADCAST = ipaddress.IPv4Address("255.255.255.255")


@lru_cache(REMEMBERED_MAX)
def node_id_of(address: str) -> NodeId:
    """The id of the node at an IPv4 address such as "127.0.0.2"; ValueError if it is none."""
    return NodeId(int(ipaddress.IPv4Address(address)))


def checked_node_id(address: str) -> NodeId:
    """The id of a node that shall be at this address; ValueError, in words, if it is no IPv4 address, or not that of one machine."""
    try:
        known = ipaddress.IPv4Address(address)
    except ValueError:
        raise ValueError(f"{address!r} is no IPv4 address") from None
    if not is_machine(NodeId(int(known))):
        raise ValueError(f"{address} is not the address of one machine")
    return NodeId(int(known))


def is_machine(node_id: NodeId) -> bool:
    """Whether the address that an id stands for can be that of one machine."""
    known = ipaddress.IPv4Address(node_id)
    return not (known in _UNSPECIFIED or known.is_multicast or known == _BROADCAST)


@lru_cache(REMEMBERED_MAX)
def address_of(node_id: NodeId) -> str:
    """The IPv4 address that a node id stands for."""
    return str(ipaddress.IPv4Address(node_id))
