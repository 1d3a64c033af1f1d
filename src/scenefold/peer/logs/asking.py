"""What clients ask of a log: one after the other is proposed, and each is answered (specs/25-consensus.md, Answers).

Whoever only looks whether something was begun (a barrier) shares that with all who wait to look, and somebody's change comes between two looks:
anybody may look, and each time all participants write.
"""

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
"""Changes that wait for those before them: beyond that, 13."""
LOOKS_MAX = 256
"""Likewise of looks, for the next one."""

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
        self._to_look: list[_Request] = []
        self._current: _Request | None = None
        self._looking: list[_Request] = []
        """Whose look the current one is."""
        self._looked_last = False
        self._is_over = False

    async def ask(self, make: Make | None, deadline: float, *, is_for_all: bool, is_forced: bool, needs_consent: bool) -> Answer:
        """Wait for the answer; without `make` it is a barrier. Cancelled, it may be proposed all the same."""
        if self._is_over:
            raise _ended()
        line, most = (self._to_look, LOOKS_MAX) if make is None else (self._waiting, WAITING_MAX)
        if len(line) >= most:
            raise Refused(RejectReason.BUSY, f"{most} requests wait for this log already", remedy="try again in a while")
        request = _Request(make, deadline, is_for_all, is_forced, needs_consent)
        line.append(request)
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
        while self._current is None and (request := self._next_request()) is not None:
            if request.is_abandoned:
                continue
            try:
                value = None if request.make is None else request.make(state.judge)
                _check(value, state)
            except Refused as refused:
                request.finish(refused)
                continue
            self._current, self._looked_last = request, request.make is None
            request.digest = None if value is None else value.digest
            return Ask(value, request.deadline, request.is_for_all, request.is_forced, request.needs_consent)
        return None

    def _next_request(self) -> _Request | None:
        self._to_look = [request for request in self._to_look if not request.is_abandoned]
        if self._to_look and not (self._waiting and self._looked_last):
            self._looking, self._to_look = self._to_look, []
            deadline = max(request.deadline for request in self._looking)
            return _Request(None, deadline, is_for_all=False, is_forced=False, needs_consent=True)
        return self._waiting.popleft() if self._waiting else None

    def expire(self, state: State, now: float) -> None:
        """Those that wait behind what is proposed are answered in time, too: however long that takes, it is not theirs."""
        for line in (self._waiting, self._to_look, self._looking):
            for request in [request for request in line if self._is_late(request, now)]:
                line.remove(request)
                request.finish(_looked(state) if line is self._looking else _late(request, state))

    def _is_late(self, request: _Request, now: float) -> bool:
        """What is proposed has the latest deadline of those whose look it is, and knows more of what became of it."""
        return request.deadline <= now and (
            self._current is None or request.deadline < self._current.deadline or request not in self._looking
        )

    def next_late_at(self) -> float:
        """When the first of those that wait is to be answered."""
        lines = (self._waiting, self._to_look, self._looking)
        return min((request.deadline for line in lines for request in line if self._is_late(request, math.inf)), default=math.inf)

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
        heard, self._looking = (self._looking, []) if request.make is None else ([request], self._looking)
        for one in heard:
            one.finish(Answer(reply.outcome, reply.position, reply.reason, reply.by))
        return any(not one.is_abandoned for one in heard)

    def end(self, position: int) -> None:
        """The log runs no more. What is proposed may still be decided."""
        self._is_over = True
        for request in (*self._looking, *(() if self._current is None else (self._current,))):
            request.finish(Answer(Outcome.UNKNOWN, position))
        for request in (*self._waiting, *self._to_look):
            request.finish(_ended())
        self._current = None
        self._waiting.clear()
        self._to_look, self._looking = [], []


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


def _looked(state: State) -> Answer:
    """What is told to one whose look goes on for others: that of their barrier, as things stand."""
    proposal, position = state.proposal, state.position + 1
    if proposal.has_met_something:
        return Answer(Outcome.UNKNOWN, position)
    return Answer(Outcome.REJECTED, position, *proposal.noted)


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
