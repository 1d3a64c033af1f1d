"""Whom a person means by a name, an address or a file, and the keys that go with it.

Whatever names a member ends in a card that the cluster's authority signed: nobody's keys are believed because somebody gave them.
"""

from __future__ import annotations

import datetime
import re
from pathlib import Path
from typing import TYPE_CHECKING

from scenefold.base.errors import LocalFault, UsageFault
from scenefold.base.ids import NodeId, address_of, checked_node_id
from scenefold.crypto import CARD_BYTES_MAX, Card
from scenefold.world.profile import ClusterProfile

if TYPE_CHECKING:
    from scenefold.client.cluster import Cluster

_MEMBER = re.compile(r"user:[A-Za-z0-9._@-]{1,50}|node:(0|[1-9][0-9]{0,9})")


def member_name(who: str) -> str:
    """ "user:ada" or "node:<id>", of that or of a node's address; UsageFault for anything else."""
    if _MEMBER.fullmatch(who):
        return who
    try:
        return f"node:{int(checked_node_id(who))}"
    except ValueError:
        remedy = "name a user as in user:ada, or a node by its address"
        raise UsageFault(f"{who[:80]!r} names no member of a cluster", where="member", remedy=remedy) from None


async def card_of(cluster: Cluster, who: str, file: Path | None = None) -> Card:
    """The verified card of whom `who` names. `file`: a certificate to take it from.

    LocalFault if there is none; DamagedData (NotOfThisCluster, OutOfDate among it) if it is not to be believed.
    """
    name = member_name(who)
    now = datetime.datetime.fromtimestamp(cluster.calls.world.clock.wall(), datetime.UTC)
    return await cluster.in_worker("import", _read, cluster.profile, name, file, now)


def _read(profile: ClusterProfile, name: str, file: Path | None, now: datetime.datetime) -> Card:
    path = _own_copy(profile, name) if file is None else file
    try:
        with path.open("rb") as certificate:
            content = certificate.read(CARD_BYTES_MAX + 1)
    except OSError as problem:
        what = f"cannot read the certificate of {name}: {problem.strerror}"
        raise LocalFault(what, where=str(path), remedy="give the member's certificate.pem with --card") from problem
    card = Card.verified(content, profile.authority_certificate(), now)
    if card.name != name:
        raise LocalFault(f"this is the certificate of {card.name}, not of {name}", where=str(path), remedy="give that of the member")
    return card


def _own_copy(profile: ClusterProfile, name: str) -> Path:
    """Where the certificate lies in the profile of whoever made the cluster."""
    kind, _, rest = name.partition(":")
    if kind == "user":
        return profile.folder / "users" / rest / "certificate.pem"
    return profile.folder / "nodes" / _address(rest) / "certificate.pem"


def _address(node: str) -> str:
    """The address of a node's id in decimal; UsageFault for a number that is none."""
    try:
        return address_of(NodeId(int(node)))
    except ValueError:
        raise UsageFault(f"{node} is no node's id", where="member", remedy="name a node by its address") from None
