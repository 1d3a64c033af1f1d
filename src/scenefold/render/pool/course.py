"""How the tracing of a job went, as its organiser saw it: rounds between moves of cells, and when how many passes were closed. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from scenefold.base.ids import NodeId
from scenefold.wire import Value

ROUNDS_MAX = 256
"""That are told; those after them are not."""
STEPS = 100
"""Of all passes that are to be traced, whose times are kept."""
TAIL = 0.95
States = Mapping[NodeId, Mapping[str, Value]]
"""What each node of the job told last."""


@dataclass(slots=True)
class Course:
    """Of one job."""

    passes: int
    """Of all of its levels together."""
    before: int = 0
    """Those of them that were closed when it began, in a kept render."""
    moves: int = 0
    _rounds: list[list[int]] = field(default_factory=list)
    """Each: visits of cells by all nodes, by the busiest one, and how many nodes there were."""
    _before: dict[NodeId, int] = field(default_factory=dict)
    _begun_at: float | None = None
    _closed_after: list[float] = field(default_factory=list)
    """By step: seconds from the beginning until so many were closed first."""

    def cells_moved(self, states: States) -> None:
        """All nodes answer for other cells."""
        self.moves += 1
        self.round_ended(states)

    def round_ended(self, states: States) -> None:
        """Cells have moved, or the last pass was closed."""
        casts = {node: _count(state.get("casts")) for node, state in states.items()}
        # One that was lost and is back counts from nothing.
        done = {node: max(count - self._before.get(node, 0), 0) for node, count in casts.items()}
        self._before.update(casts)
        if any(done.values()) and len(self._rounds) < ROUNDS_MAX:
            self._rounds.append([sum(done.values()), max(done.values()), len(done)])

    def closed(self, passes: int, now: float) -> None:
        """So many are closed at this time; the first time that anybody asks is the beginning. After a loss it may be fewer than there were."""
        self._begun_at = now if self._begun_at is None else self._begun_at
        traced, all_of_them = passes - self.before, self.passes - self.before
        while len(self._closed_after) < STEPS and traced >= math.ceil(all_of_them * (len(self._closed_after) + 1) / STEPS):
            self._closed_after.append(now - self._begun_at)

    @property
    def tail(self) -> list[float]:
        """Seconds until 95 of 100 of the passes that were traced were closed, and until all were; empty if that is not known."""
        steps = self._closed_after
        return [steps[math.ceil(TAIL * len(steps)) - 1], steps[-1]] if steps else []

    def document(self, *, is_done: bool) -> dict[str, Value]:
        """For whoever asks how the job stands: rounds and tail once it is done."""
        rounds: list[Value] = [list(one) for one in self._rounds] if is_done else []
        return {"moved": self.moves, "rounds": rounds, "tail": list(self.tail) if is_done else []}


def _count(value: Value | None) -> int:
    return value if isinstance(value, int) else 0
