"""Several voters of the cluster's log in a run: named once the founders are members, and again whoever has lost its disk
(specs/17-simulation.md, Voters)."""

from __future__ import annotations

from contextlib import suppress

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.peer import NodeContext
from scenefold.peer.cluster_log.registry import Registry
from scenefold.simulation.cluster import Cluster, Node
from scenefold.simulation.disks import incarnation_of, ready_at
from scenefold.wire import AddParticipant, LogEntry, Member
from scenefold.wire.enrol_entries import Trust

LOOK_S = 2.0


class Senate:
    """An extension of every node. `count`: how many shall vote; 1: nothing is done, and the log's key decides."""

    def __init__(self, cluster: Cluster, count: int) -> None:
        self._cluster, self._count = cluster, count

    async def run(self, context: NodeContext, *, task_status: trio.TaskStatus[None]) -> None:
        """On the first of those that vote, as long as it lives: name whoever is lacking, one after the other, as an administrator would."""
        task_status.started()
        while self._count > 1:
            await trio.sleep(LOOK_S)
            entry = self._next(context.cluster_log.registry) if self._at_work()[:1] == [context] else None
            if entry is not None:
                with suppress(Refused, Unreachable, PeerFault):
                    await context.cluster_log.propose(entry)

    def missing(self) -> str:
        """What is not as it shall be, for people; empty if all vote, and may."""
        if self._count <= 1:
            return ""
        able = [context for context in self._at_work() if context.cluster_log.voting.is_ready]
        return "" if len(able) == self._count else f"{len(able)} of {self._count} voters are there, and ready"

    def may_lose(self, node: Node) -> bool:
        """Whether the others that vote are a majority, with their disks, and ready: else nobody could decide anything any more."""
        context = self._cluster.voter.context
        voters = None if context is None else context.cluster_log.registry.voting.deciders
        if context is None or voters is None:
            return node is not self._cluster.nodes[0]
        if voters.member_of(node.node_id) is None:
            return True
        # Who knows what those before granted tells it to those who come: of these a majority has to be left.
        council = context.cluster_log.registry.voting.councils[-1].position
        able = {one.member.node for one in voters.everyone if self._is_able(one.member, council)}
        return len(able - {node.node_id}) >= voters.majority

    def _is_able(self, member: Member, council: int) -> bool:
        disk = self._cluster.nodes[self._cluster.slot_of(member.node)].disk
        return incarnation_of(disk) == member.incarnation and ready_at(disk) == council

    def _at_work(self) -> list[NodeContext]:
        """Nodes that vote, and run; the one that does so from the start until there are others."""
        found = [node.context for _, node in sorted(self._cluster.running.items()) if node.context is not None]
        return [context for context in found if context.me in context.cluster_log.registry.voters]

    def _next(self, registry: Registry) -> LogEntry | None:
        if not registry.position or len(registry.voting.deciders.everyone if registry.voting.deciders else ()) >= self._count:
            return None
        for slot in range(len(self._cluster.facts.founders)):
            node = self._cluster.nodes[slot]
            known = registry.current(node.node_id)
            if known is None or (registry.voting.deciders is not None and node.node_id in registry.voters):
                continue
            if not registry.is_trusted(node.node_id):
                return Trust(node.node_id, True, known.sealing_key.raw, b"sealed")
            return AddParticipant(known.member, known.key.raw)
        return None


def is_voter(cluster: Cluster, node: Node) -> bool:
    """Whether a node decides the cluster's log, as far as anybody knows."""
    context = cluster.voter.context
    return node is cluster.nodes[0] if context is None else node.node_id in context.cluster_log.registry.voters
