"""What clients borrowed of a participant's lease (specs/26-modes.md, Lent leases)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from scenefold.base.ids import KeyId
from scenefold.peer.timing import T_WAIT_S

LENT_FACTOR = 1.05
"""Who lent holds it for live so much longer than it lent for: rates of clocks differ by 1 % at most, and four more percent are free."""
BORROWERS_MAX = 1_024
PROCESSES_MAX = 64
"""Of one key: whoever has it could make up as many as he likes, and leave no room to others."""


class Borrower(NamedTuple):
    """A client: its key, and what its process drew."""

    key: KeyId
    process: bytes


class Lent(NamedTuple):
    borrower: Borrower
    until: float


@dataclass(frozen=True, slots=True)
class Lender:
    lent: tuple[Lent, ...] = field(default=())
    careful_until: float = -math.inf
    """Until then something is live that was lent before the start, for all that this node knows."""

    @classmethod
    def started(cls, now: float) -> Lender:
        return cls(careful_until=now + T_WAIT_S)

    def lend(self, borrower: Borrower, for_s: float, now: float) -> Lender:
        """`for_s`: what is left of the lender's own lease. To be called behind nothing that waits: it counts from the answer."""
        until = max([now + LENT_FACTOR * for_s, *(lent.until for lent in self.lent if lent.borrower == borrower)])
        others = (lent for lent in self.lent if lent.borrower != borrower and now < lent.until)
        return replace(self, lent=(*others, Lent(borrower, until)))

    def left_of(self, borrower: Borrower, now: float) -> float:
        """How long somebody may be told to have what he has already, if he counts anew from when he asks: it is live for no longer."""
        return max([0.0, *((lent.until - now) / LENT_FACTOR for lent in self.lent if lent.borrower == borrower)])

    def given_back(self, borrower: Borrower) -> Lender:
        return replace(self, lent=tuple(lent for lent in self.lent if lent.borrower != borrower))

    def borrowers(self, now: float) -> frozenset[Borrower]:
        """Whose leases may still be used."""
        return frozenset(lent.borrower for lent in self.lent if now < lent.until)

    def is_live(self, now: float) -> bool:
        """Whether somebody may still use something that was lent here."""
        return now < self.careful_until or any(now < lent.until for lent in self.lent)

    def has_room(self, borrower: Borrower, now: float) -> bool:
        borrowers = self.borrowers(now)
        of_key = sum(other.key == borrower.key for other in borrowers)
        return borrower in borrowers or (len(borrowers) < BORROWERS_MAX and of_key < PROCESSES_MAX)
