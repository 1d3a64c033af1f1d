"""Whom a person means by a name, an address or a file, and the keys that go with it.

Whatever names a member ends in a card that the cluster's authority signed: nobody's keys are believed because somebody gave them.
Nor because the authority did: who has its key may renew certificates where no log is at hand, so the log is asked for each whose keys count.
"""

from __future__ import annotations

import datetime
import re
from pathlib import Path
from typing import TYPE_CHECKING

from scenefold.base.errors import LocalFault, UsageFault
from scenefold.base.ids import checked_node_id
from scenefold.crypto import CARD_BYTES_MAX, Card, node_named
from scenefold.world.profile import ClusterProfile

if TYPE_CHECKING:
    from scenefold.client.cluster import Cluster
    from scenefold.client.membership import Membership
    from scenefold.world.log_view import LogView

_SEE = "see `scenectl cluster users` and `cluster nodes`"
_MEMBER = re.compile(r"user:[A-Za-z0-9._@-]{1,50}|node:(0|[1-9][0-9]{0,9})")


def member_name(who: str) -> str:
    """ "user:ada" or "node:<id>", of that or of a node's address, with "node:" before it or not; UsageFault for anything else."""
    if _MEMBER.fullmatch(who):
        return who
    try:
        node = checked_node_id(who.removeprefix("node:"))
    except ValueError:
        remedy = "name a user as in user:ada, or a node by its address"
        raise UsageFault(f"{who[:80]!r} names no member of a cluster", where="member", remedy=remedy) from None
    return f"node:{int(node)}"


async def card_for(cluster: Cluster, who: str, file: Path | None = None) -> Card:
    """The verified card of whom `who` names, as the cluster knows it. `file`: a certificate to take it from instead.

    LocalFault if there is none, or the member's keys are others by now, or none; DamagedData (NotOfThisCluster, OutOfDate among it) if it is not to be believed.
    """
    name = member_name(who)
    if file is None:
        return await cluster.card_of(name)
    now = datetime.datetime.fromtimestamp(cluster.calls.world.clock.wall(), datetime.UTC)
    card = await cluster.in_worker("import", read_card, cluster.profile, name, file, now)
    check_present(cluster.membership, card, await cluster.log.newest(), cluster.profile, str(file))
    return card


def check_present(membership: Membership, card: Card, view: LogView, profile: ClusterProfile, where: str) -> None:
    """LocalFault unless the keys in a card are those by which the cluster's log knows the member now."""
    refusal = view.refusal_of(card.name, card.signing_id)
    if refusal is not None:
        raise LocalFault(refusal.what, where=where, remedy=f"who was invited again has other keys, and a certificate for these; {_SEE}")
    node = node_named(card.name)
    if node is None:
        known = view.card_of(card.name, profile.owners())
        present = None if known is None else (known.keys.signing.raw, known.keys.sealing.raw)
    else:
        present = membership.known_keys(node, view)
    if present is None:
        raise LocalFault(f"{card.name} is no member of {profile.name}", where=where, remedy=_SEE)
    if present != (card.keys.signing.raw, card.keys.sealing.raw):
        raise LocalFault(
            f"these are not the keys by which {card.name} is known", where=where, remedy="give the newest certificate, or none"
        )


def read_card(profile: ClusterProfile, name: str, file: Path, now: datetime.datetime) -> Card:
    """The card in a certificate's file, if it is this member's."""
    try:
        with file.open("rb") as certificate:
            content = certificate.read(CARD_BYTES_MAX + 1)
    except OSError as problem:
        raise LocalFault(f"cannot read the certificate: {problem.strerror}", where=str(file), remedy="give a certificate.pem") from problem
    card = Card.verified(content, profile.authority_certificate(), now)
    if card.name != name:
        raise LocalFault(f"this is the certificate of {card.name}, not of {name}", where=str(file), remedy="give that of the member")
    return card
