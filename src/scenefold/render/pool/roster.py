"""Who takes part in an attempt of a job, and what follows from that (specs/31-attempts.md). Pure."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, Self

from scenefold.base.errors import PeerFault
from scenefold.base.ids import NodeId
from scenefold.base.plain_values import whole
from scenefold.render.job import Job
from scenefold.wire import Value

ATTEMPT_MAX = 2**63 - 1


@dataclass(frozen=True, slots=True)
class Roster:
    """A node's place is its index in `nodes`; cells and passes go by places."""

    attempt: int
    nodes: tuple[NodeId, ...]
    """In the order of the line."""
    organiser: NodeId

    @classmethod
    def first(cls, job: Job, organiser: NodeId) -> Self:
        """All of the job."""
        return cls(0, job.nodes, organiser)

    def changed(self, job: Job, lost: Collection[NodeId], back: Collection[NodeId]) -> Roster:
        """The next attempt, without those that are lost, and with those of the job that are back."""
        stay = {*self.nodes, *back} - {*lost}
        return Roster(self.attempt + 1, tuple(node for node in job.nodes if node in stay), self.organiser)

    def place(self, node: NodeId) -> int | None:
        """None if it takes no part."""
        return self.nodes.index(node) if node in self.nodes else None

    def keeper(self, place: int) -> int | None:
        """Who keeps a copy of what the node at a place has closed; None if nobody does: it would be of no use, or there is nobody."""
        if len(self.nodes) == 1 or self.nodes[place] == self.organiser:
            return None
        return (place + 1) % len(self.nodes)

    def document(self) -> dict[str, Value]:
        """As it is told."""
        return {"hold": self.attempt, "nodes": [int(node) for node in self.nodes]}

    @classmethod
    def from_document(cls, document: dict[str, Any], job: Job, organiser: NodeId, me: NodeId) -> Self:
        """What `document` gave, as `organiser` told it to `me`. PeerFault unless some of the job's nodes take part, in their order, both of these among them."""
        try:
            attempt = whole(document["hold"], 1, ATTEMPT_MAX)
            nodes = tuple(NodeId(whole(node, 0, 2**32 - 1)) for node in document["nodes"])
        except (KeyError, TypeError, ValueError) as error:
            raise PeerFault("a roster is ill-formed", where=f"{type(error).__name__}: {error}") from error
        if nodes != tuple(node for node in job.nodes if node in nodes) or not {organiser, me} <= set(nodes):
            raise PeerFault("a roster is not of some of the job's nodes")
        return cls(attempt, nodes, organiser)
