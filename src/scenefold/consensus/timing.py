"""How long is waited for what, in seconds. Only how soon something is decided depends on these, never what (specs/25-consensus.md, Timers)."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from scenefold.wire import ProposalId

_EXPONENT_MAX = 6
_PATIENCE_MAX = 4.0
_LAST_PATIENCE_MAX = 16.0
"""Before a ballot is given up, by a node of which several came to nothing."""


def _patience(counter: int) -> float:
    """A ballot that comes after others is waited for longer: what these waited for may only have been slow, and asking more often makes it slower."""
    return min(_PATIENCE_MAX, 2.0 ** max(0, min(counter, _EXPONENT_MAX) - 1))


def _last_patience(counter: int, tries: int) -> float:
    """Likewise once everything was sent again: what is lost does not come by waiting longer before that, and what is slow does by waiting after it."""
    return max(_patience(counter), min(_LAST_PATIENCE_MAX, 2.0 ** min(tries, _EXPONENT_MAX)))


class Waits(Enum):
    """What a timer is for."""

    ANSWERS = "answers of both arms"
    REST = "the pause before the next ballot"
    HOP = "what comes back from further out"
    ORPHAN = "whoever had begun what this node has voted for"
    DEADLINE = "what whoever asks is told at the latest"


@dataclass(frozen=True, slots=True)
class Timer:
    """One set again is one timer. `proposal`: of the pass or hop that it belongs to."""

    waits: Waits
    proposal: ProposalId | None = None


@dataclass(frozen=True, slots=True)
class Timing:
    hop_s: float = 0.3
    """For one hop out and home. Links that are slower are waited for in later ballots, which have more time."""
    pass_s_min: float = 0.9
    base_s: float = 0.1
    """The least pause before another ballot, and between two nodes that could take over."""
    takeover_s: float = 30.0
    """After so long without success a takeover ends, and the wait for T_ORPHAN begins anew."""

    def pass_s(self, arm: int, counter: int = 1) -> float:
        """For a pass whose longer arm visits so many nodes, in a ballot with this counter."""
        return self._pass_s(arm) * _patience(counter)

    def repeat_s(self, arm: int, counter: int, tries: int) -> float:
        """For the same pass once more, at a node of whose ballots so many came to nothing."""
        return self._pass_s(arm) * _last_patience(counter, tries)

    def _pass_s(self, arm: int) -> float:
        return max(self.pass_s_min, self.hop_s * (arm + 1))

    def hops_s(self, further: int, counter: int = 1) -> float:
        """At a hop, behind which the arm visits so many nodes."""
        return self.hop_s * (further + 1) * _patience(counter)

    def rest_s(self, tries: int) -> tuple[float, float]:
        """Between which bounds the pause after so many tries is drawn."""
        return self.base_s, self.base_s * 2.0 ** min(tries, _EXPONENT_MAX)

    def orphan_s(self, participants: int, rank: int) -> tuple[float, float]:
        """Between which bounds the time is drawn after which a node takes over what it has heard nothing of; others, of lower rank, do so before it."""
        least = 2 * self.pass_s(participants - 1) + rank * self.base_s
        return least, least + self.base_s
