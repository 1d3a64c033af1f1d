"""Voters that live, and say nothing to the removal of a node: for how long (specs/15-cluster-log.md, Voters, *Proposing*)."""

from __future__ import annotations

from dataclasses import dataclass

from scenefold.base.ids import NodeId
from scenefold.wire import Member

MISSED_S = 30.0
"""A voter that lives, and for so long says nothing to a removal, can write nothing down: the others go on without it."""
MISSED_AGAIN_S = 90.0
"""Attempts that are further apart say nothing of the time between them: who wants a node removed tries again within a minute."""


@dataclass(frozen=True, slots=True)
class _Silence:
    """Of one voter to the removal of one incarnation, from the first attempt that missed it to the last."""

    voter: NodeId | None
    since: float
    last: float


class Missed:
    """What the attempts of one voter have met."""

    def __init__(self) -> None:
        self._silences: dict[Member, _Silence] = {}

    def is_for_long(self, removed: Member, now: float) -> bool:
        """Whether the removal may do without whoever says nothing to it."""
        known = self._silences.get(removed)
        return known is not None and now - known.last <= MISSED_AGAIN_S and now - known.since >= MISSED_S

    def note(self, removed: Member, voter: NodeId | None, now: float) -> None:
        """An attempt came to nothing for want of this voter's word; if that was another one before, or long ago, it begins anew."""
        self._silences = {member: known for member, known in self._silences.items() if now - known.last <= MISSED_AGAIN_S}
        known = self._silences.get(removed)
        since = now if known is None or known.voter != voter else known.since
        self._silences[removed] = _Silence(voter, since, now)

    def clear(self, removed: Member) -> None:
        """An attempt has had another outcome."""
        self._silences.pop(removed, None)
