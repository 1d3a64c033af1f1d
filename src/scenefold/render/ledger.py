"""The ledger of one pass: when has every ray of it ended? (rendering.md, Passes; specs/08-passes.md)

Each node counts, per pass, rays it created, retired, sent to other nodes and received from them. The pass's
owner gathers the counts. A single reading proves nothing, for it is not taken at one moment: rays may have
been received on a node after it was read and sent from one before. So the owner reads twice (Mattern 1987,
the four-counter method): if what was received by the first reading equals what was sent by the second, no ray
was under way in between. With the second reading come the nodes' sums, which are then complete.

Counts only ever grow; the owner keeps the newest of each node. Pure: values in, values out.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto


@dataclass(frozen=True, slots=True)
class Counts:
    """Rays of one pass on one node."""

    created: int = 0
    retired: int = 0
    sent: int = 0
    received: int = 0

    def __add__(self, other: Counts) -> Counts:
        return Counts(
            self.created + other.created,
            self.retired + other.retired,
            self.sent + other.sent,
            self.received + other.received,
        )

    @property
    def is_settled(self) -> bool:
        """Whether every created ray is retired and every sent one received, as far as these counts tell."""
        return self.created == self.retired and self.sent == self.received


class PassState(Enum):
    """OPEN: rays fly. COLLECTING: the second reading is under way. CLOSED: the sums are complete."""

    OPEN = auto()
    COLLECTING = auto()
    CLOSED = auto()


class PassLedger:
    """The owner's view of one pass."""

    def __init__(self, nodes: int) -> None:
        self.state = PassState.OPEN
        self._first: list[Counts | None] = [None] * nodes
        self._second: list[Counts | None] = [None] * nodes
        self._first_total = Counts()

    def report(self, node: int, counts: Counts) -> bool:
        """Take a node's counts; True if the second reading should begin now.

        A node that never reported has created and received nothing, or its rays are missing from the balance.
        """
        known = self._first[node]
        if known is None or _is_newer(counts, known):
            self._first[node] = counts
        return self.state is PassState.OPEN and self._total(self._first).is_settled and self._has_begun()

    def begin_collection(self) -> None:
        """The second reading begins. What is reported from now on is no part of the first: it may be younger than
        some of the second, and then the two would prove nothing."""
        assert self.state is PassState.OPEN
        self.state = PassState.COLLECTING
        self._first_total = self._total(self._first)
        self._second = [None] * len(self._second)

    def collected(self, node: int, counts: Counts) -> PassState:
        """Take a node's second reading. The last one decides: CLOSED, or OPEN again, the sums being discarded."""
        assert self.state is PassState.COLLECTING
        self._second[node] = counts
        if all(reading is not None for reading in self._second):
            second = self._total(self._second)
            closed = self._first_total == second and second.is_settled
            for index, reading in enumerate(self._second):
                assert reading is not None
                known = self._first[index]
                if known is None or _is_newer(reading, known):
                    self._first[index] = reading
            self.state = PassState.CLOSED if closed else PassState.OPEN
        return self.state

    def abandon_collection(self) -> None:
        """A node did not answer: the pass is open as before."""
        if self.state is PassState.COLLECTING:
            self.state = PassState.OPEN

    @property
    def looks_settled(self) -> bool:
        """Whether the newest counts balance, so that another collection is worth a try."""
        return self._has_begun() and self._total(self._first).is_settled

    def _has_begun(self) -> bool:
        return self._total(self._first).created > 0

    @staticmethod
    def _total(readings: list[Counts | None]) -> Counts:
        total = Counts()
        for reading in readings:
            if reading is not None:
                total = total + reading
        return total


def _is_newer(counts: Counts, known: Counts) -> bool:
    return counts.created + counts.retired + counts.sent + counts.received > known.created + known.retired + known.sent + known.received
