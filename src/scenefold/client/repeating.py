"""Whether a change of a scene's log that is repeated is the one that the log has under its request (specs/16-scene-log.md, Doubt). Pure."""

from __future__ import annotations

from collections.abc import Callable

from scenefold.base.errors import LocalFault, Refused, ScenefoldError
from scenefold.base.limits import CLIENT_LOG_TRIES_MAX
from scenefold.base.reasons import RejectReason
from scenefold.client.log_reading import ReadLog
from scenefold.client.requests import Request
from scenefold.scene.log import OpenedLog, SceneLog
from scenefold.wire import LogEntry

_NOTHING_DONE = "nothing was done now"


def check_told_of(log: SceneLog, request: Request, name: str) -> None:
    """Refused (2) if a request that the log does not show may be in it all the same, as so much was decided since."""
    if request.offered_at and not is_told_of(log, request.offered_at):
        what = f"so much was decided since position {request.offered_at} that the log does not tell any more whether this change is in it"
        remedy = f"{_NOTHING_DONE}; look what the scene is like, and make the change without the request if it is missing"
        raise Refused(RejectReason.POSITION_BEHIND, what, where=f"scene {name}", remedy=remedy)


def is_told_of(log: SceneLog, offered_at: int) -> bool:
    """Whether a request that was offered at this position last, and is not among those of the log, is not in it."""
    return log.tells_of(max(1, offered_at - CLIENT_LOG_TRIES_MAX))


def state_before(log: OpenedLog, position: int) -> SceneLog | None:
    """The state that the record of this position was made from; None if the record is in a snapshot. Takes time with the number of records."""
    beginning = log.beginning()
    if position <= beginning.position:
        return None
    return beginning.extended(record.decoded() for record in log.records[: position - beginning.position - 1])


def check_same(read: ReadLog, before: SceneLog | None, request: Request, entry_of: Callable[[SceneLog], LogEntry], name: str) -> None:
    """LocalFault if the log has something else under the request than `entry_of` makes of `before`, the state of `state_before`; Refused (2) if nobody can tell."""
    position, where = read.state.requests[request.id], f"scene {name}"
    if before is None:
        what = f"this request is in the log, at position {position}, so long ago that nobody can tell which change it was"
        raise Refused(RejectReason.POSITION_BEHIND, what, where=where, remedy=f"{_NOTHING_DONE}; look what the scene is like")
    try:
        wanted = before.next_record(entry_of(before), request.id, read.header.origin).encode()
    except ScenefoldError:
        # It did not even fit there.
        wanted = b""
    if wanted != read.log.records[position - read.state.position - 1].record:
        what = f"this request is that of another change, which is in the log at position {position}"
        remedy = f"{_NOTHING_DONE}; give the request that the error of this very change named, or none for a new change"
        raise LocalFault(what, where=where, remedy=remedy)
