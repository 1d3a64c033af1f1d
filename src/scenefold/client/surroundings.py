"""What the cluster is like around a node: whether what it waits for comes by itself, or somebody has to do something (specs/11-peers.md, Removal). Pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from scenefold.base.ids import node_id_of
from scenefold.base.prefixes import address_prefix, forbids
from scenefold.client.copy_reports import CopiesReport
from scenefold.client.health import NodeState
from scenefold.client.listing import some_text


@dataclass(frozen=True, slots=True)
class Surroundings:
    """Made by `surroundings_of`. All are addresses."""

    nodes: tuple[NodeState, ...]
    silent: tuple[str, ...]
    removable: tuple[str, ...]
    """Of the silent those that the cluster removes by itself after a while."""
    refusing: tuple[str, ...]
    """Nodes that refuse some writes, as too few others may hold copies of what they own."""

    @property
    def start(self) -> str:
        """What to do about the silent ones; only where time helps as well it is said that one may wait."""
        start = f"start {some_text(self.silent)}"
        if not self.removable:
            return start
        return f"{start}, or wait until the cluster removes {'what stays silent' if self.removable == self.silent else some_text(self.removable)}"

    def has_room(self, node: NodeState, copies: CopiesReport, count: int) -> bool:
        """Whether so many other nodes answer, own a part of the line, may hold what this one owns, and have room for it."""
        blacklist, me = [address_prefix(prefix) for prefix in node.blacklist], node_id_of(node.address)
        others = [other.address for other in self.nodes if other.report is not None and other.report.arc is not None]
        able = [other for other in others if other not in copies.full and not forbids(blacklist, node_id_of(other), owner=me)]
        return len(able) >= count


def surroundings_of(nodes: Sequence[NodeState]) -> Surroundings:
    """Of all nodes of the cluster."""
    silent = tuple(node.address for node in nodes if not node.alive)
    voters = [node for node in nodes if node.is_voter]
    # Removals are decided by most of the voters, who hear half of the members at least; and no voter is removed.
    decides = 2 * sum(voter.alive for voter in voters) > len(voters) and 2 * len(silent) <= len(nodes)
    removable = tuple(node.address for node in nodes if not node.alive and not node.is_voter) if decides else ()
    copies = [(node.address, node.report.copies) for node in nodes if node.report is not None and node.report.copies is not None]
    refusing = tuple(address for address, told in copies if any(short.forbids_writes for short in told.shortages))
    return Surroundings(tuple(nodes), silent, removable, refusing)
