"""Ballots: who tries to get a position decided, and for the how manieth time (specs/25-consensus.md, Terms)."""

from __future__ import annotations

from collections.abc import Iterable

from scenefold.base.ids import NodeId
from scenefold.wire import Ballot

NO_BALLOT = Ballot(0, NodeId(0))
"""Below all that are made."""
COUNTER_MAX = 2**32 - 1
"""A ballot's counter has 32 bits. Hints are signed, so nobody but a participant could drive it there."""


def first_ballot(node: NodeId) -> Ballot:
    """The first one of a position, of whoever may have that: below all others, and so without promises."""
    return Ballot(0, node)


def is_first(ballot: Ballot) -> bool:
    """Whether it is a position's first ballot, if its node may have that."""
    return ballot.counter == 0


def next_ballot(node: NodeId, met: Iterable[Ballot]) -> Ballot | None:
    """A ballot of this node above all that were met; None if there is none left."""
    counter = max((ballot.counter for ballot in met), default=0) + 1
    return Ballot(counter, node) if counter <= COUNTER_MAX else None
