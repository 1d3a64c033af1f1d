"""What a node knows of one other member: its newest status, and when it lived (specs/11-peers.md, Roster). Pure."""

from __future__ import annotations

import math

from scenefold.base.location import FIRST, Arc, Location
from scenefold.wire import MiniStatus, Status


class KnownPeer:
    """A peer under its registered incarnation; None: a founder that never came."""

    __slots__ = ("bound", "bound_lamport", "heard_at", "incarnation", "lamport", "proof_at", "proofs", "said_at", "signs", "status")

    def __init__(self, incarnation: bytes | None, since: float) -> None:
        """`since`: when this node learnt of the membership; silence is counted from then on at the earliest."""
        self.incarnation = incarnation
        self.proof_at = since
        self.status: Status | None = None
        self.lamport = -1
        """The newest Lamport time heard: of a status or of a mini status."""
        self.heard_at: float | None = None
        self.signs = 0
        self.proofs = 0
        self.bound: Location | None = None
        """The right bound that it named last, be it in passing; None: it owns nothing."""
        self.bound_lamport = -1
        """When it named that; -1: never."""
        self.said_at = -math.inf
        """Local time of the newest word on its arc that came from itself, or that was news."""

    def would_change_by(self, status: Status) -> bool:
        """Whether a status is of this incarnation, and newer than the newest that is known."""
        return status.incarnation == self.incarnation and (self.status is None or status.lamport > self.status.lamport)

    @property
    def arc(self) -> Arc | None:
        """What it claims: from its newest left fence to its newest right bound. Where these do not fit, the last place alone is certain."""
        if self.bound is None:
            return None
        status, first = self.status, self.bound
        if status is not None and status.right_bound is not None:
            first = FIRST if status.left_fence is None else status.left_fence.next() or first
        return Arc(min(first, self.bound), self.bound)

    def said(self, news: Status | MiniStatus, now: float, *, relayed: bool) -> None:
        """It has said what it owns; of a status it is already in `status`."""
        is_news = news.lamport > self.bound_lamport and (self.bound_lamport < 0 or news.right_bound != self.bound)
        if news.lamport > self.bound_lamport:
            self.bound, self.bound_lamport = news.right_bound, news.lamport
        # A mini status does not repeat where the arc begins, so one without news is no newer word on all of it.
        if is_news or (isinstance(news, Status) and not relayed):
            self.said_at = now

    def gave_sign(self, lamport: int, now: float, *, is_proof: bool) -> None:
        """It lived at this Lamport time, and has said so itself if that is a proof."""
        # What the peer says itself may also fall: an old folder that came and went must not drown out the right one.
        self.lamport = lamport
        self.heard_at = now
        self.signs += 1
        if is_proof:
            self.bound_lamport = min(self.bound_lamport, lamport)
            self.proofs += 1
            self.proof_at = now
