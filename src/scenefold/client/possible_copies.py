"""How many copies of a space's records there can be, by the nodes that a client knows of and their blacklists (specs/20-copies.md, Placement). Pure.

Nodes say the same in their reports once they know the space; whoever makes one hears it at once.
"""

from __future__ import annotations

from collections.abc import Sequence

from scenefold.client.copy_reports import ShortageReport
from scenefold.client.shortages import Shortage, rules_of
from scenefold.client.table import Owner


def shortages_to_come(owners: Sequence[Owner], copies: int, copies_min: int) -> list[Shortage]:
    """Where a space with so many copies would lack some: everywhere, for want of nodes; or of what a node owns, by its blacklist.

    `owners`: all nodes of the cluster. While none of them owns anything all are taken to do so.
    """
    owning = [owner for owner in owners if owner.right_bound is not None] or list(owners)
    idle = [owner for owner in owners if owner not in owning]
    needed = min(copies_min, copies, max(1, len(owners)))
    addresses = [owner.address for owner in owners]
    found: list[Shortage] = []
    for owner in owning:
        allowed = [other for other in owners if owner.may_be_held_by(other.node_id)]
        with_arc = sum(other in owning for other in allowed)
        # Who owns nothing holds copies only as far as writes need them.
        possible = 1 + min(copies - 1, max(with_arc, min(needed - 1, len(allowed))))
        if possible == copies:
            continue
        is_forbidden = len(allowed) < len(owners) - 1
        told = ShortageReport(copies, needed, possible, owner.address if is_forbidden else None, needed)
        if is_forbidden:
            found.append(Shortage(owner.address, (told,), rules=rules_of(owner.address, map(str, owner.blacklist), addresses)))
        elif not any(not known.address for known in found):
            found.insert(0, Shortage("", (told,), idle=tuple(other.address for other in idle)))
    return found
