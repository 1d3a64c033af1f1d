"""How the tracing of a job went, as its organiser saw it: rounds between moves of cells, and when how many passes were closed. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from scenefold.base.ids import NodeId
from scenefold.wire import Value

ROUNDS_MAX = 256
"""That are told; those after them are not."""
MOMENTS_MAX = 1_024
"""Whose counts of closed passes are kept; of more every other one goes."""
TAIL_PASSES_MIN = 20
"""Fewer have no tail: the last of them are more than 5 of 100."""
TAIL = 0.95
States = Mapping[NodeId, Mapping[str, Value]]
"""What each node that took part told last."""


@dataclass(slots=True)
class Course:
    """Of one job."""

    passes: int
    """Of all of its levels together."""
    before: int = 0
    """Of these, that another job has traced."""
    moves: int = 0
    _rounds: list[list[int]] = field(default_factory=list)
    """Each: visits of cells by all nodes, by the busiest one, and how many took part."""
    _counts: dict[NodeId, int] = field(default_factory=dict)
    """When the last round ended, of those that took part in it."""
    _begun_at: float | None = None
    _closed: list[tuple[int, float]] = field(default_factory=list)
    """Ascending: so many were closed, first, so many seconds from the beginning."""

    def cells_moved(self, states: States) -> None:
        """All nodes answer for other cells."""
        self.moves += 1
        self.round_ended(states)

    def round_ended(self, states: States) -> None:
        """Cells have moved, another attempt begins, or the last pass was closed. `states`: of those that took part since the last one, and no others."""
        counts = {node: whole_of(state.get("casts")) for node, state in states.items()}
        done = {node: _since(self._counts.get(node, 0), count) for node, count in counts.items()}
        self._counts = counts
        if any(done.values()) and len(self._rounds) < ROUNDS_MAX:
            self._rounds.append([sum(done.values()), max(done.values()), len(done)])

    def closed(self, passes: int, now: float) -> None:
        """So many are closed at this time; the first time that anybody asks is the beginning. After a loss it may be fewer than there were."""
        self._begun_at = now if self._begun_at is None else self._begun_at
        if passes > (self._closed[-1][0] if self._closed else self.before):
            self._closed.append((passes, now - self._begun_at))
        if len(self._closed) > MOMENTS_MAX:
            self._closed = [*self._closed[:-1:2], self._closed[-1]]

    @property
    def tail(self) -> list[float]:
        """Seconds until 95 of 100 of the passes that were traced were closed, and until all were; empty if that is not known, or they were few."""
        traced = self._closed[-1][0] - self.before if self._closed else 0
        if traced < TAIL_PASSES_MIN:
            return []
        most = next(at for count, at in self._closed if count - self.before >= math.ceil(TAIL * traced))
        return [most, self._closed[-1][1]]

    def document(self, *, is_done: bool) -> dict[str, Value]:
        """For whoever asks how the job stands: rounds and tail once it is done."""
        rounds: list[Value] = [list(one) for one in self._rounds] if is_done else []
        return {"moved": self.moves, "rounds": rounds, "tail": list(self.tail) if is_done else []}


def whole_of(value: Value | None) -> int:
    """What a node counts, as it tells it; 0 if it tells nothing of the kind."""
    return value if isinstance(value, int) else 0


def _since(before: int, count: int) -> int:
    """A node that was lost and is back counts from nothing."""
    return count - before if count >= before else count
