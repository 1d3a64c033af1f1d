"""Where a newcomer goes on the line: left of the node that most needs relief, or at a place (specs/13-balance.md, Joining). Pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from scenefold.base.ids import NodeId
from scenefold.base.location import Arc, Location


@dataclass(frozen=True, slots=True)
class Host:
    """A member beside which a newcomer may go. `arc`: as far as is known. `alive`: it is believed to be."""

    node: NodeId
    arc: Arc | None
    used: int
    capacity: int
    alive: bool = True


def most_loaded(hosts: Sequence[Host]) -> NodeId | None:
    """Of the living nodes that own something the fullest by proportion; equal ones: the longest arc, then the lower id.

    Nobody owns anything, or nobody lives: any that lives, else any at all; None without members.
    """

    def need(host: Host) -> tuple[bool, bool, float, int, int]:
        proportion = host.used / host.capacity if host.capacity else 0.0
        length = 0 if host.arc is None else host.arc.length
        return host.alive, host.arc is not None, proportion, length, -host.node

    return max(hosts, key=need).node if hosts else None


def owner_of(hosts: Sequence[Host], place: Location) -> NodeId | None:
    """The node whose arc holds the place; of several the first. None if that is nobody's, as far as is known."""
    return next((host.node for host in hosts if host.arc is not None and place in host.arc), None)
