"""What a node knows of one other member: its newest status, and when it lived (specs/11-peers.md, Roster). Pure."""

from __future__ import annotations

from scenefold.wire import Status


class KnownPeer:
    """A peer under its registered incarnation; None: a founder that never came."""

    __slots__ = ("heard_at", "incarnation", "lamport", "proof_at", "proofs", "signs", "status")

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

    def would_change_by(self, status: Status) -> bool:
        """Whether a status is of this incarnation, and newer than the newest that is known."""
        return status.incarnation == self.incarnation and (self.status is None or status.lamport > self.status.lamport)

    def gave_sign(self, lamport: int, now: float, *, is_proof: bool) -> None:
        """It lived at this Lamport time, and has said so itself if that is a proof."""
        # What the peer says itself may also fall: an old folder that came and went must not drown out the right one.
        self.lamport = lamport
        self.heard_at = now
        self.signs += 1
        if is_proof:
            self.proofs += 1
            self.proof_at = now
