"""How long a client tries: a silent node a few times, one that says "not now" for as long as a lease gap lasts. Pure.

A node that has lost its owner lease, or whose arc is changing hands, has it back or is replaced within some seconds,
and says so; waiting for it is the whole remedy. A node that says nothing may be gone for good.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

from scenefold.base.errors import PeerFault, Refused, ScenefoldError, Unreachable
from scenefold.base.limits import CLIENT_BUSY_TRIES_MAX, CLIENT_PAUSE_S, CLIENT_PAUSE_S_MAX, CLIENT_TRIES_MAX
from scenefold.base.reasons import RejectReason

Problem = TypeVar("Problem", bound=ScenefoldError)

_PASSING = frozenset({RejectReason.BUSY, RejectReason.NOT_READY, RejectReason.NOT_MY_LOCATION})
"""Reasons that may be gone after a pause, with a newer table."""


def is_passing(reason: int) -> bool:
    """Whether a refusal for this reason is worth another try after a pause."""
    return reason in _PASSING


def heaviest(problems: Sequence[Unreachable | Refused | PeerFault]) -> Unreachable | Refused | PeerFault:
    """What several who may own a place come to if none has an answer: a refusal that lasts, else what may pass.

    Who answers with nonsense counts only if nobody said anything else: it must not speak for the others.
    """

    def weight(problem: Unreachable | Refused | PeerFault) -> int:
        if isinstance(problem, PeerFault):
            return 0
        return 2 if isinstance(problem, Refused) and not is_passing(problem.reason) else 1

    return max(reversed(problems), key=weight)


def as_told(problem: Problem) -> Problem | Refused:
    """What is told when patience is over: a node that said "not now" all the while gives its reason of the moment, and often no remedy.

    13 need not be load: a place may be frozen by a handover, an id still in use, another's lease not over. So no load is blamed.
    """
    if not isinstance(problem, Refused) or problem.reason is not RejectReason.BUSY or problem.remedy:
        return problem
    remedy = "repeat it in a while; `scenectl cluster status` tells what is amiss, `scenectl cluster top` which nodes are busy"
    return Refused(RejectReason.BUSY, f"not now, however often it was tried: {problem.what}", where=problem.where, remedy=remedy)


class Patience:
    """Of one call: whether to try again, and after which pause."""

    def __init__(self) -> None:
        self._silences = 0
        self._failures = 0

    def bears(self, error: Unreachable | Refused | None) -> bool:
        """Count a failed try, None for one that only was sent elsewhere; whether there shall be another."""
        self._failures += 1
        if isinstance(error, Unreachable):
            self._silences += 1
        elif error is not None and not is_passing(error.reason):
            return False
        return self._silences < CLIENT_TRIES_MAX and self._failures < CLIENT_BUSY_TRIES_MAX

    def pause_s(self, uniform: float) -> float:
        """Before the next try: longer each time up to a bound, and not for everybody the same. `uniform`: 0 <= x < 1."""
        return min(CLIENT_PAUSE_S_MAX, CLIENT_PAUSE_S * 3.0 ** (self._failures - 1)) * (0.5 + uniform)
