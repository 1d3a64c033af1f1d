"""What a request costs the node, as measured where there is a clock for it (specs/03-wire.md, Limits).

A request is handled in a task that runs for a moment, waits, and runs again; `metered` adds these moments up, by the clock on the
wall: while one runs no other can, even if the machine has the thread wait in the middle of it. What it has worker threads do counts
as well, wherever that is asked for (`running_bill`), by the time of the processor; and so does what is found out about it, as that
its records were not signed. In a simulated world computing takes no time, and only estimates are paid.
"""

from __future__ import annotations

import time
import types
from collections import deque
from collections.abc import Callable, Coroutine, Generator
from contextvars import ContextVar
from typing import Any, ParamSpec, TypeVar

T = TypeVar("T")
P = ParamSpec("P")

Stopwatch = Callable[[], float]
"""Seconds since some moment."""

FORGED_S = 0.001
"""What a packet that is none, or a record whose signature is none of its writer's, costs beside the time it takes: no honest program
sends any, so who does it again and again gets less and less."""
PAID_AT_ONCE_S = 0.001
"""Less is paid together with what comes next."""


class Bill:
    """Of one request, or of all that a connection costs beside them. `estimate_s` is paid at once, and is the least that it costs.

    `accuse`: called when what is asked turns out to be forged.
    """

    def __init__(
        self,
        pay: Callable[[float], None],
        stopwatch: Stopwatch | None,
        estimate_s: float = 0.0,
        accuse: Callable[[], None] = lambda: None,
    ) -> None:
        self.accuse = accuse
        self._pay = pay
        self._stopwatch = stopwatch
        self._estimate_s = estimate_s
        self._spent_s = self._paid_s = 0.0
        self._of_threads = deque[float]()
        self._pay_up_to(estimate_s)

    def spend(self, seconds: float) -> None:
        """It has taken so long."""
        self._spent_s += seconds
        while self._of_threads:
            self._spent_s += self._of_threads.popleft()
        if self._spent_s - self._paid_s >= PAID_AT_ONCE_S:
            self._pay_up_to(self._spent_s)

    def close(self, answer_s: float = 0.0) -> None:
        """It is handled; `answer_s`: what its answer costs by estimate."""
        self._pay_up_to(max(self._spent_s, self._estimate_s + answer_s))

    def _pay_up_to(self, seconds: float) -> None:
        if seconds > self._paid_s:
            self._pay(seconds - self._paid_s)
            self._paid_s = seconds

    def in_thread(self, function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
        """Call this in a worker thread of a real world. It is paid for with the next moment of the task."""
        began = time.thread_time()
        try:
            return function(*args, **kwargs)
        finally:
            self._of_threads.append(time.thread_time() - began)

    async def metered(self, work: Coroutine[Any, Any, T]) -> T:
        """Await this on this bill, as what is left for the present task to do."""
        _running.set(self)
        return await (work if self._stopwatch is None else _step_by_step(work, self.spend, self._stopwatch))


_running: ContextVar[Bill | None] = ContextVar("bill", default=None)


def running_bill() -> Bill | None:
    """That of the request on whose behalf this runs, if it is known."""
    return _running.get()


def charge_forged(count: int) -> None:
    """To whoever asked for what is being done: it holds so many packets or records that no honest program sends."""
    bill = _running.get()
    if bill is not None and count:
        bill.accuse()
        bill.spend(count * FORGED_S)


@types.coroutine
def _step_by_step(work: Coroutine[Any, Any, T], spend: Callable[[float], None], stopwatch: Stopwatch) -> Generator[Any, Any, T]:
    """What `await` does, with a look at the clock on either side of each step."""
    value: Any = None
    error: BaseException | None = None
    while True:
        began = stopwatch()
        try:
            trap = work.send(value) if error is None else work.throw(error)
        except StopIteration as end:
            result: T = end.value
            return result
        finally:
            error = None
            spend(stopwatch() - began)
        try:
            value = yield trap
        except BaseException as thrown:  # noqa: BLE001 - a cancellation is passed on like any other
            error = thrown
