"""Errors that travel between nodes and to clients, so that whoever asked for an image hears why there is none.

A JobAnswer has a reason and a text, a job's state has `failure_reason` and `failure`. The text is the error's what, where
and remedy on a line each; the reason tells what may pass (NOT_READY: a node is away) from what will fail again.
"""

from __future__ import annotations

from scenefold.base.errors import DamagedData, LocalFault, PeerFault, Refused, ScenefoldError, Unreachable
from scenefold.base.reasons import RejectReason
from scenefold.wire import Value
from scenefold.world import QuietLog, leaves

PART_CHARACTERS_MAX = 160
"""Of each of the three parts: together they fit a packet's text, whatever the alphabet."""


def reason_of(error: ScenefoldError) -> RejectReason:
    """Why, as a number: OUTSIDE_BOUNDS for what was asked for and cannot be."""
    match error:
        case Refused():
            return error.reason
        case Unreachable():
            return RejectReason.NOT_READY
        case DamagedData():
            return RejectReason.SIGNATURE_INVALID
        case PeerFault():
            return RejectReason.ILL_FORMED
        case _:
            return RejectReason.OUTSIDE_BOUNDS


def words_of(error: ScenefoldError) -> str:
    """The error's what, where and remedy, a line each."""
    return "\n".join(" ".join(part.split())[:PART_CHARACTERS_MAX] for part in (error.what, error.where, error.remedy))


def failure_fields(error: ScenefoldError | None) -> dict[str, Value]:
    """The fields of a state that say how the job, or a node's part, failed; empty words if it did not."""
    if error is None:
        return {"failure": "", "failure_reason": 0}
    return {"failure": words_of(error), "failure_reason": int(reason_of(error))}


def told(error: ScenefoldError) -> Refused:
    """The error as whoever asks for it hears it."""
    return Refused(reason_of(error), error.what, where=error.where, remedy=error.remedy)


def failure_of(group: ExceptionGroup[Exception], job: int, quiet: QuietLog, now: float) -> Refused:
    """What a job failed of: the first error, without the traceback, whose frames hold keys. A bug is told, and fails the job and not the node."""
    errors = list(leaves(group))
    for bug in errors:
        if not isinstance(bug, ScenefoldError):
            kind = type(bug).__name__
            # All jobs are one source: whoever may render may make up as many as they like.
            quiet.say(now, "a render", kind, f"job {job:016x}: an internal error, {kind}", bug)
    known = [error for error in errors if isinstance(error, ScenefoldError)]
    return told(known[0] if known else LocalFault("a node failed over the job", remedy="its log says more"))


def error_of(reason: int, words: str, *, where: str = "", before: str = "") -> Refused:
    """The error that `reason_of` and `words_of` speak of. `where` if it names no place, `before`: what it stopped."""
    what, place, remedy = (*words.split("\n"), "", "")[:3]
    known = RejectReason(reason) if reason in set(RejectReason) else RejectReason.ILL_FORMED
    return Refused(known, before + (what or "no reason is given"), where=place or where, remedy=remedy)
