"""Whom a certificate names."""

from __future__ import annotations

import re
from functools import lru_cache

from cryptography import x509
from cryptography.x509.oid import NameOID

from scenefold.base.ids import NodeId

NAME_PATTERN = re.compile(r"node:(?:0|[1-9][0-9]{0,9})|user:[A-Za-z0-9._@-]{1,50}")
"""A node has one name, without leading zeros: two certificates for the same node have the same name."""
_NODE_ID_MAX = 2**32 - 1


@lru_cache(maxsize=1024)
def node_named(name: str) -> NodeId | None:
    """The node that a member's name speaks of; None for a user, or what is no node's name. Asked several times for each request."""
    kind, _, number = name.partition(":")
    if kind != "node" or not NAME_PATTERN.fullmatch(name) or int(number) > _NODE_ID_MAX:
        return None
    return NodeId(int(number))


def common_name(certificate: x509.Certificate) -> str:
    """The subject's common name; empty if there is none."""
    names = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    return str(names[0].value) if names else ""
