"""Who can be asked for what has rotted on this node's disk (specs/20-copies.md, Healing). Pure."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

from scenefold.base.ids import NodeId
from scenefold.base.placement import Layout
from scenefold.peer.copies.copies import Copies
from scenefold.peer.copies.segment import GONE
from scenefold.store import Spot
from scenefold.wire import Member


class Sources(NamedTuple):
    """Who may have a record, the surest first. Of a wreck `sure` is who certainly has what lay there, or newer; without them `all_of` are heard."""

    members: tuple[Member, ...]
    sure: tuple[Member, ...]
    all_of: tuple[Member, ...]
    is_own: bool
    is_nowhere_else: bool = False
    """Whether so many are owed what lay there that it was never acknowledged."""


def sources_of(copies: Copies, layout: Layout | None, spot: Spot, debtors: Collection[NodeId], *, owns: bool) -> Sources | None:
    """Who may have what lies at a spot; None if nobody is known. `debtors`: to whom it is owed. Pure."""
    me = copies.configurations.me
    if not layout:
        return None
    if not owns:
        entry = copies.custody.at(layout, spot.home)
        if entry is None:
            return None
        return Sources(tuple(member for member in entry.members if member != me), (entry.owner,), (), is_own=False)
    segment = copies.configurations.at(layout, spot.home)
    if segment is None:
        return None
    named = {member for found in segment.configurations for member in found.members} | set(segment.holders(me))
    asked = [member for member in named if member != me and segment.bound_of(member) != GONE]
    ordered = tuple(sorted(asked, key=lambda member: (member not in segment.sound, member.node, member.incarnation)))
    sure = tuple(member for member in ordered if member in segment.sound and member.node not in debtors)
    # Where one node is enough, what lay here may have been nowhere else, as if this disk had been lost; certainly so if all are owed it.
    is_elsewhere = bool(segment.configurations) and all(found.needed > 1 for found in segment.configurations)
    may_be_elsewhere = is_elsewhere or any(member.node not in debtors for member in ordered)
    owed = set(debtors)
    is_nowhere_else = bool(segment.configurations) and all(
        sum(member.node not in owed for member in found.members) < found.needed for found in segment.configurations
    )
    return Sources(ordered, sure, ordered if may_be_elsewhere else (), is_own=True, is_nowhere_else=is_nowhere_else)
