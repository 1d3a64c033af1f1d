"""A node's owner lease, where several voters grant it (specs/26-modes.md, Owner leases; Lives, with a majority). Pure.

Whoever runs this makes a life durable before it asks under it, gives each question to all voters, and every answer back. The lease counts
from when was asked, on this node's own clock; what was granted under a life that an earlier process drew only says that it was granted.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from scenefold.base.reasons import RejectReason
from scenefold.consensus import Participants
from scenefold.peer.cluster_log.numbered_lives import FIRST_NUMBER, Life
from scenefold.peer.timing import LIFE_S, T_LEASE_S
from scenefold.wire import Member


@dataclass(frozen=True, slots=True)
class Round:
    """One question to all voters."""

    nonce: int
    have: int
    asked_at: float
    voters: Participants
    """Who decides behind `have`."""
    granted: frozenset[Member] = frozenset()
    refused: frozenset[Member] = frozenset()
    """With 18."""

    @property
    def is_granted(self) -> bool:
        return len(self.granted) >= self.voters.majority

    @property
    def is_refused(self) -> bool:
        """Those who have not refused are no majority."""
        return len(self.voters.everyone) - len(self.refused) < self.voters.majority


@dataclass(frozen=True, slots=True)
class LeaseAsker:
    """`life`: as it is on the disk; None before the first. Times are local ones."""

    life: Life | None = None
    others: tuple[Life, ...] = ()
    """What the disk holds besides, from the time of one voter, and voters may know instead."""
    is_granted: bool = False
    """This process knows that a majority has granted `life`."""
    drawn_at: float = -math.inf
    """When this process drew `life`; never, if an earlier one did."""
    until: float = -math.inf
    is_restored: bool = False
    """So many voters know of a later life that this disk must be an older one."""
    round: Round | None = None
    lease_s: float = T_LEASE_S
    life_s: float = LIFE_S

    @classmethod
    def of_disk(cls, lives: Sequence[Life], lease_s: float = T_LEASE_S, life_s: float = LIFE_S) -> LeaseAsker:
        """After a start. More lives than one are those of `of_one_voter`."""
        return cls(life=lives[0] if lives else None, others=tuple(lives[1:]), lease_s=lease_s, life_s=life_s)

    def holds(self, now: float) -> bool:
        return now < self.until

    def wants_life(self, now: float) -> bool:
        """Whether it is time to draw one. Only once the one before was granted; where there is none, that stands for it."""
        return self.life is None or (self.is_granted and now >= self.drawn_at + self.life_s)

    def drawn(self, mark: int, now: float) -> LeaseAsker:
        """With a new life, to be made durable before anything is asked under it. `mark`: random, not 0."""
        life = Life(FIRST_NUMBER, mark) if self.life is None else self.life.next(mark)
        return replace(self, life=life, others=(), is_granted=False, drawn_at=now, round=None)

    def asks(self, nonce: int, have: int, voters: Participants, now: float) -> LeaseAsker:
        """A new question; answers to those before count no more."""
        assert self.life is not None
        return replace(self, round=Round(nonce, have, now, voters))

    def granted(self, nonce: int, voter: Member) -> LeaseAsker:
        asked = self._round(nonce, voter)
        if asked is None:
            return self
        asked = replace(asked, granted=asked.granted | {voter})
        if not asked.is_granted:
            return replace(self, round=asked)
        until = asked.asked_at + self.lease_s if asked.asked_at < self.drawn_at + self.life_s else self.until
        return replace(self, round=None, is_granted=True, until=max(self.until, until))

    def refused(self, nonce: int, voter: Member, reason: RejectReason) -> LeaseAsker:
        """A single refusal says little: so does a voter that was told of two lives of one number."""
        asked = self._round(nonce, voter)
        if asked is None or reason is not RejectReason.WRONG_INCARNATION:
            return self
        asked = replace(asked, refused=asked.refused | {voter})
        if not asked.is_refused:
            return replace(self, round=asked)
        if self.others:
            return replace(self, life=self.others[0], others=self.others[1:], round=None)
        return replace(self, round=None, is_restored=True, until=-math.inf)

    def removed(self) -> LeaseAsker:
        """The log says that this incarnation is a member no more."""
        return replace(self, round=None, until=-math.inf)

    def _round(self, nonce: int, voter: Member) -> Round | None:
        """What an answer of this voter belongs to, if it counts."""
        asked = self.round
        return asked if asked is not None and asked.nonce == nonce and voter in asked.voters else None
