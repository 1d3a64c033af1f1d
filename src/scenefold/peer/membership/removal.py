"""May this member be removed? What the voter knows against it (specs/11-peers.md, Removal). Pure.

Gossip only guesses; the voter has heard every member that asked for its owner lease within the last seconds, so it has
the last word before a removal is committed. It never lets itself be removed. And it lets nobody be removed while it hears
less than half of the members: then it is more likely itself that is cut off, and it must not remove all the others.
"""

from __future__ import annotations

from dataclasses import dataclass

from scenefold.peer.cluster_log.registered import NO_INCARNATION
from scenefold.wire import Member

UNREGISTERED_FACTOR = 5
"""Such a founder holds a seat and nothing else: a slow start of the cluster is no reason to take it."""


@dataclass(frozen=True, slots=True)
class Evidence:
    """What the voter knows of a member whose removal is proposed. Times are of its own clock."""

    is_voter: bool
    proof_at: float
    """Last proof of life, else since when the voter knows that it is a member."""
    leased_at: float | None
    """When the voter last granted it an owner lease; None: not since the voter started."""
    members: int
    members_proven: int
    """Of these, those that gave proof of life within `remove_after_s`, the voter included."""


def silence_needed_s(member: Member, remove_after_s: float) -> float:
    """The silence that the removal of a member takes."""
    return remove_after_s * (UNREGISTERED_FACTOR if member.incarnation == NO_INCARNATION else 1)


def removal_veto(member: Member, evidence: Evidence, remove_after_s: float, now: float) -> str | None:
    """Why the member must not be removed now; None if nothing speaks against it but an answer to a probe."""
    if evidence.is_voter:
        return "a voter is never removed for its silence"
    silence_s = now - max(evidence.proof_at, evidence.proof_at if evidence.leased_at is None else evidence.leased_at)
    needed_s = silence_needed_s(member, remove_after_s)
    if silence_s < needed_s:
        return f"the voter knows that it lived {silence_s:.0f} s ago; a removal takes {needed_s:.0f} s of silence"
    if 2 * evidence.members_proven < evidence.members:
        return f"the voter hears {evidence.members_proven} of {evidence.members} members: it may be cut off itself"
    return None
