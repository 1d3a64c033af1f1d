"""From when on a mode that was decided is acted by (specs/26-modes.md, Activation)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from scenefold.peer.modes.releases import Releases
from scenefold.peer.timing import T_WAIT_S
from scenefold.wire import Ballot, Member, Vote


@dataclass(frozen=True, slots=True)
class Switch:
    """A SetMode that is decided. `participants`, `observers`: who may have held a lease of before, P(L) and O(L).

    `ballot`: that of a certificate. Whoever voted in this one or a later one has voted for the switch, and for nothing else since.
    """

    position: int
    digest: bytes
    ballot: Ballot
    participants: frozenset[Member]
    observers: frozenset[Member]

    def is_for_good(self, vote: Vote) -> bool:
        """Whether who cast this true vote asks for no lease of before any more. A vote of an earlier ballot may have been followed by another one."""
        is_for_it = (vote.position, vote.digest) == (self.position, self.digest)
        return is_for_it and vote.ballot >= self.ballot and vote.member in self.participants


@dataclass(frozen=True, slots=True)
class Activation:
    """Of the newest switch that a node knows. `switch` None: there was none, or it lies before the start, and only time tells."""

    learnt_at: float = -math.inf
    switch: Switch | None = None
    removed_at: float = -math.inf
    """When this node last learnt that somebody who may hold leases was removed."""
    voters: frozenset[Member] = frozenset()
    was_active: bool = False
    """It was found to be: what is learnt later changes nothing about that."""

    @classmethod
    def started(cls, now: float, *, was_switched: bool) -> Activation:
        """A start counts as learning all that is on the disk. A scene that never left its first mode has nothing to wait for."""
        return cls(now if was_switched else -math.inf, removed_at=now)

    def switched(self, switch: Switch, now: float) -> Activation:
        """A SetMode is learnt to be decided."""
        return Activation(now, switch, self.removed_at)

    def removed(self, releases: Releases, now: float) -> Activation:
        """A removal is learnt."""
        return replace(self, was_active=self.is_active(releases, now), removed_at=now)

    def voted(self, vote: Vote) -> Activation:
        """A true vote of somebody was seen."""
        if self.switch is None or not self.switch.is_for_good(vote):
            return self
        return replace(self, voters=self.voters | {vote.member})

    def is_active(self, releases: Releases, now: float) -> bool:
        """Whether the newest mode may be acted by, at this moment."""
        return self.was_active or now >= self.learnt_at + T_WAIT_S or (now >= self.removed_at + T_WAIT_S and self._all_said(releases))

    def _all_said(self, releases: Releases) -> bool:
        """Clause (a), but for removals: nobody who was there holds, or lent, a lease of before."""
        switch = self.switch
        if switch is None:
            return False
        silent = (switch.participants - self.voters) | switch.observers
        return all(releases.cover(member, switch.position) for member in silent)
