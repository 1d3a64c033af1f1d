"""Whom a client asks first, before any node has told it who is there (specs/11-peers.md, First contact). Pure.

A profile names the nodes that the cluster began with, or through which somebody came. Who joined since then stands in the cluster's log, of
which the profile keeps what its clients have verified: so whichever node is away, the others are asked.
"""

from __future__ import annotations

from collections.abc import Sequence

from scenefold.base.ids import NodeId, address_of, node_id_of
from scenefold.crypto.invitations import ADDRESSES_MAX
from scenefold.world.log_view import LogView
from scenefold.world.profile import ClusterProfile

CONTACTS_MAX = 16
"""Nodes besides the founders: with more of them away at once, it is this computer that has no network. More of them only if all are seeds."""


def contacts(profile: ClusterProfile, view: LogView) -> list[tuple[NodeId, str]]:
    """Who may be there besides the founders: the profile's seeds, all that somebody named, then those that the log has now, trusted ones first,
    and spares."""
    seeds = dict.fromkeys(node_id_of(seed) for seed in profile.seeds)
    named = [node for node in seeds if node not in profile.founders]
    known = dict.fromkeys([*trusted_first(view), *(member.node_id for member in profile.members)])
    others = [node for node in known if node not in seeds and node not in profile.founders]
    return [(node, address_of(node)) for node in [*named, *others][: max(CONTACTS_MAX, len(named))]]


def trusted_first(view: LogView) -> list[NodeId]:
    """The nodes that came and count, as the log has them: those that the cluster trusts before the others, both in the order of the line."""
    return sorted((node for node in view.members if view.keys_of(node) is not None), key=lambda node: node not in view.roll.trusted)


def named_in_a_token(profile: ClusterProfile, view: LogView) -> Sequence[NodeId]:
    """Whom a newcomer asks: first the seeds that are on the line, then others that are, since any of them may be away when it comes."""
    seeds, members = [node_id_of(seed) for seed in profile.seeds], trusted_first(view)
    there = [node for node in seeds if not members or node in members]
    return list(dict.fromkeys([*there, *members, *seeds]))[:ADDRESSES_MAX]
