"""How long answers take that take long: nineteen of twenty came sooner (specs/20-copies.md, Reads). Pure.

Whoever asks somebody else as soon as one is slower than that doubles one request in twenty, and no longer waits for a slow disk. It is
what is usual among nodes that counts: were all answers counted together, one node in five that is always slow would say what slow is.
"""

from __future__ import annotations

import math
from collections import defaultdict, deque

from scenefold.base.ids import NodeId

KEPT = 64
LEAST = 8
"""Before so many answers nothing is known of a node."""
BEHIND = 3
"""So often in a row holders of copies were sooner than an owner that was worth waiting for."""
SPARE_MAX = 16.0
SPARE_PART = 0.25
"""For each answer, so many questions may be asked of others as well because it was slow: where all are slow, since there is too much to do,
asking twice makes it worse."""
PATIENT_S = 10.0
"""After so long others are asked in any case."""
CLASSES = (4, 16, math.inf)
"""Questions are alike that ask for up to so many records."""


class Tail:
    """Of the latest answers of one node to questions that are alike."""

    def __init__(self) -> None:
        self._seconds: deque[float] = deque(maxlen=KEPT)
        self.slow_s: float | None = None
        """Nineteen of twenty were sooner; None as long as too few are known."""

    def note(self, seconds: float) -> None:
        """An answer took so long."""
        self._seconds.append(seconds)
        if len(self._seconds) >= LEAST:
            self.slow_s = sorted(self._seconds)[len(self._seconds) * 19 // 20]


class Tails:
    """Of all nodes. What is not known yet is `unknown_s`; no limit is below `least_s`, nor above `most_s`."""

    def __init__(self, *, unknown_s: float, least_s: float, most_s: float) -> None:
        self._unknown_s, self._least_s, self._most_s = unknown_s, least_s, most_s
        self._tails: list[dict[NodeId, Tail]] = [defaultdict(Tail) for _ in CLASSES]
        self._late: dict[NodeId, int] = {}
        self._spare = SPARE_MAX

    def note(self, node: NodeId, records: int, seconds: float) -> None:
        """A node took so long to answer for so many records, and nobody was sooner."""
        self._tails[_class_of(records)][node].note(seconds)
        self._spare = min(SPARE_MAX, self._spare + SPARE_PART)
        self._late.pop(node, None)

    def was_late(self, node: NodeId) -> None:
        """Others had been asked beside it, and knew sooner."""
        self._late[node] = self._late.get(node, 0) + 1

    def asked_others(self) -> None:
        """Somebody was slow, and so others are asked as well."""
        self._spare = max(0.0, self._spare - 1)

    def is_behind(self, node: NodeId) -> bool:
        """Whether a node is slow all the time: it is not worth waiting for before others are asked as well."""
        return self._late.get(node, 0) >= BEHIND

    def limit_s(self, records: int) -> float:
        """After so long it is worth asking somebody else for so many records as well: `usual_s`, or, where too much was asked of others lately, PATIENT_S."""
        return PATIENT_S if self._spare < 1 else self.usual_s(records)

    def usual_s(self, records: int) -> float:
        """What is slow for the faster half of the nodes. Where that is not known of so few records, what is known of more."""
        for tails in self._tails[_class_of(records) :]:
            known = sorted(tail.slow_s for tail in tails.values() if tail.slow_s is not None)
            if known:
                return min(max(known[(len(known) - 1) // 2], self._least_s), self._most_s)
        return self._unknown_s


def _class_of(records: int) -> int:
    return next(number for number, most in enumerate(CLASSES) if records <= most)
