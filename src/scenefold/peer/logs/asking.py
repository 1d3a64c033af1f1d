"""What clients ask of a log: one after the other is proposed, and each is answered (specs/25-consensus.md, Answers)."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import trio

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId
from scenefold.base.limits import LOG_BODY_BYTES_MAX, LOG_EXPOSED_MAX, LOG_RECORD_BYTES_MAX
from scenefold.base.reasons import RejectReason
from scenefold.consensus import Ask, Judge, Reply, State, Value
from scenefold.consensus.effects import Outcome

WAITING_MAX = 64
"""Requests that wait for those before them: beyond that, 13."""

Make = Callable[[Judge], Value]
"""What to propose at the position behind what this judge knows; Refused if that makes no sense there. It is asked anew for each position."""


class Answer(NamedTuple):
    """COMMITTED: at `position`. REJECTED: `reason`, and `by` whom, None if by nobody in particular. UNKNOWN, OPEN: ask again."""

    outcome: Outcome
    position: int
    reason: RejectReason | None = None
    by: NodeId | None = None


@dataclass(slots=True, eq=False)
class _Request:
    make: Make | None
    deadline: float
    is_for_all: bool
    is_forced: bool
    needs_consent: bool
    digest: bytes | None = None
    done: trio.Event = field(default_factory=trio.Event)
    answer: Answer | Exception | None = None
    is_abandoned: bool = False

    def finish(self, answer: Answer | Exception) -> None:
        self.answer = answer
        self.done.set()


class Asking:
    """`wake` is called when there is something new to be proposed."""

    def __init__(self, wake: Callable[[], None]) -> None:
        self._wake = wake
        self._waiting: deque[_Request] = deque()
        self._current: _Request | None = None
        self._is_over = False

    async def ask(self, make: Make | None, deadline: float, *, is_for_all: bool, is_forced: bool, needs_consent: bool) -> Answer:
        """Wait for the answer; without `make` it is a barrier. Cancelled, it may be proposed all the same."""
        if self._is_over:
            raise _ended()
        if len(self._waiting) >= WAITING_MAX:
            raise Refused(RejectReason.BUSY, f"{WAITING_MAX} requests wait for this log already", remedy="try again in a while")
        request = _Request(make, deadline, is_for_all, is_forced, needs_consent)
        self._waiting.append(request)
        self._wake()
        try:
            await request.done.wait()
        finally:
            request.is_abandoned = True
        if isinstance(request.answer, Exception):
            raise request.answer
        assert request.answer is not None
        return request.answer

    def next(self, state: State, now: float) -> Ask | None:
        """What to propose now; None if nobody asks for anything. To be called while the last one is settled."""
        self.expire(state, now)
        while self._current is None and self._waiting:
            request = self._waiting.popleft()
            if request.is_abandoned:
                continue
            try:
                value = None if request.make is None else request.make(state.judge)
                _check(value, state)
            except Refused as refused:
                request.finish(refused)
                continue
            self._current = request
            request.digest = None if value is None else value.digest
            return Ask(value, request.deadline, request.is_for_all, request.is_forced, request.needs_consent)
        return None

    def expire(self, state: State, now: float) -> None:
        """Those that wait behind what is proposed are answered in time, too: however long that takes, it is not theirs."""
        late = [request for request in self._waiting if request.deadline <= now]
        for request in late:
            self._waiting.remove(request)
            request.finish(_late(request, state))

    def next_late_at(self) -> float:
        """When the first of those that wait is to be answered."""
        return min((request.deadline for request in self._waiting), default=math.inf)

    @property
    def is_proposing(self) -> bool:
        return self._current is not None

    def hear(self, reply: Reply) -> bool:
        """An answer of the machine. False if nobody waits for it any more."""
        request = self._current
        if request is None or reply.digest != request.digest:
            return False
        self._current = None
        if request.make is not None and reply.outcome is Outcome.REJECTED and reply.reason is RejectReason.POSITION_BEHIND:
            # Another value has this position, and this one never will: it may be asked for at the next one.
            self._waiting.appendleft(request)
            return True
        request.finish(Answer(reply.outcome, reply.position, reply.reason, reply.by))
        return not request.is_abandoned

    def end(self, position: int) -> None:
        """The log runs no more. What is proposed may still be decided."""
        self._is_over = True
        if self._current is not None:
            self._current.finish(Answer(Outcome.UNKNOWN, position))
        for request in self._waiting:
            request.finish(_ended())
        self._current = None
        self._waiting.clear()


def _late(request: _Request, state: State) -> Answer | Refused:
    """What is told to one whose turn did not come: by what is decided here, and by what this node has begun earlier or is at, for whomever."""
    position = state.position + 1
    if request.make is not None:
        try:
            value = request.make(state.judge)
        except Refused as refused:
            return refused
        found = state.judge.found(value)
        if found is not None:
            return Answer(Outcome.COMMITTED, found)
        if value.digest in state.slot.exposed | {state.slot.accepted_digest, state.proposal.digest}:
            return Answer(Outcome.UNKNOWN, position)
    return Answer(Outcome.REJECTED, position, RejectReason.NO_MAJORITY)


def _check(value: Value | None, state: State) -> None:
    """Refused if what this leads to could not be kept."""
    if value is None:
        return
    if len(value.data) > LOG_RECORD_BYTES_MAX or len(value.body) > LOG_BODY_BYTES_MAX:
        what = f"a value of {len(value.data)} bytes, with {len(value.body)} more, is asked for"
        raise Refused(RejectReason.LIMIT_EXCEEDED, f"{what}; {LOG_RECORD_BYTES_MAX} and {LOG_BODY_BYTES_MAX} are the most")
    if len(state.slot.exposed) >= LOG_EXPOSED_MAX and value.digest not in state.slot.exposed:
        raise Refused(RejectReason.BUSY, "too much was asked for of which nobody knows what became", remedy="try again in a while")


def _ended() -> Refused:
    return Refused(RejectReason.NOT_READY, "this node runs the log no more", remedy="ask another node")
