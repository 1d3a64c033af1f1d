"""Virtual time: Trio's clock in a simulation, and the queue of everything that will happen outside of its tasks.

Trio asks its clock how long to sleep only when no task can run. That is the one moment at which time may pass, so here
it jumps: to the next event of the queue (a packet arrives, a sync ends), which is carried out on the spot, or to the
next deadline of a task, whichever is first. Computing takes no time. An event costs one entry of a heap and one
call; there is no task per packet (FoundationDB's and TigerBeetle's simulators deliver the same way).

Nothing here can hang silently: if nobody can run and nothing will happen, if virtual time, steps or real seconds run out,
or if an event fails, the main task is cancelled and the reason raised, with a list of who waits where.
"""

from __future__ import annotations

import gc
import heapq
import itertools
import math
import time
from collections import Counter
from collections.abc import Callable, Iterator

import trio
from trio._core._entry_queue import EntryQueue
from trio._core._run import CancelStatus
from trio.lowlevel import Abort, Task

GRACE_STEPS = 100_000
"""Steps that the tasks have for their end once a limit is passed; then the run is broken off."""
STEPS_BETWEEN_CHECKS = 4_096
EVENTS_AT_ONCE_MAX = 200_000
"""Events at one instant: a thousand nodes that all send to two hundred others at once, without any delay."""
POLLS_MAX = 100
"""Looks for what Trio itself has under way (it finalizes generators through a pipe) before an idle run is a deadlock."""
COLLECT_STEPS = 1 << 18
"""Garbage is collected every so many steps and not by the interpreter's mood: finalizers run, too, at a fixed place."""
WAITING_SHOWN_MAX = 60


class SimulationStuck(Exception):
    """A simulation cannot end: a deadlock, or one of its limits. Says which, and what all tasks wait for."""


class VirtualTime(trio.abc.Clock):
    """Seconds since the start of the simulation. Give it to `trio.run`, or let `run_simulated` do so."""

    def __init__(self, *, virtual_s_max: float = math.inf, steps_max: float = math.inf, wall_s_max: float = math.inf) -> None:
        self.now = 0.0
        self.events = 0
        """Events carried out so far."""
        self.steps = 0
        """Rounds of Trio's loop and looks at the clock so far: what a busy loop of tasks uses up."""
        self.failure: BaseException | None = None
        self._queue: list[tuple[float, int, Callable[..., None], tuple[object, ...]]] = []
        self._sequence = itertools.count()
        self._virtual_s_max = virtual_s_max
        self._steps_max = steps_max
        self._wall_s_max = wall_s_max
        self._wall_begin = time.perf_counter()
        self._next_check = STEPS_BETWEEN_CHECKS
        self._next_collection = COLLECT_STEPS
        self._failed_at = math.inf
        self._polls = 0
        self._shields_are_down = False
        self._events_before = 0
        """How many there were when time last moved."""
        self.main = trio.CancelScope()
        """What a failure cancels: everything that the simulation runs should be inside."""

    def after(self, seconds: float, function: Callable[..., None], *args: object) -> float:
        """Call `function(*args)` in so many virtual seconds; returns when that is. Equal times keep their order.

        It is called between two steps of tasks, must not block, and may wake tasks. What it raises ends the simulation.
        """
        assert seconds >= 0, f"an event {-seconds} s ago"
        return self.at(self.now + seconds, function, *args)

    def at(self, when: float, function: Callable[..., None], *args: object) -> float:
        """The same at a time; what has passed is now."""
        when = nanoseconds(max(when, self.now))
        heapq.heappush(self._queue, (when, next(self._sequence), function, args))
        return when

    async def sleep(self, seconds: float) -> None:
        """As `trio.sleep`, by an event: without a scope of cancellation, at a quarter of the price."""
        sleeper: list[Task] = [trio.lowlevel.current_task()]

        def give_up(_: object) -> Abort:
            sleeper.clear()
            return Abort.SUCCEEDED

        self.after(seconds, _wake, sleeper)
        await trio.lowlevel.wait_task_rescheduled(give_up)

    @property
    def pending(self) -> int:
        """Events that are still to come."""
        return len(self._queue)

    # ------------------------------------------------------------------------------------------- what Trio calls

    def start_clock(self) -> None:
        self._wall_begin = time.perf_counter()

    def current_time(self) -> float:
        self.steps += 1
        if self.steps >= self._next_check:
            self._next_check = self.steps + STEPS_BETWEEN_CHECKS
            self._check_limits()
        return self.now

    def deadline_to_sleep_time(self, deadline: float) -> float:
        """Called when no task can run. Lets time pass up to the next thing that happens, and says "do not sleep"."""
        runner = trio._core._run.GLOBAL_RUN_CONTEXT.runner
        if runner.waiting_for_idle:
            return math.inf  # trio.testing.wait_all_tasks_blocked: this is the silence, before time passes.
        queue = self._queue
        while queue and queue[0][0] <= deadline:
            when, _, function, args = heapq.heappop(queue)
            if function is _wake and not args[0]:
                continue  # A sleep that was cancelled: time does not pass for it.
            if when > self._virtual_s_max and self._too_late(when):
                return 0.0
            if when > self.now:
                self.now, self._events_before = when, self.events
            elif self.events - self._events_before > EVENTS_AT_ONCE_MAX:
                self.fail(SimulationStuck(f"time stands still at {self.now:.9f} s: {function} is due again and again\n{who_waits()}"))
            self.events += 1
            self._polls = 0
            try:
                function(*args)
            except BaseException as error:  # noqa: BLE001 - Trio's loop would take it for a fault of its own
                self.fail(error)
            deadline = runner.deadlines.next_deadline()
            if runner.runq or deadline <= self.now or self.failure is not None or calls_wait(runner.entry_queue):
                return 0.0
            # It woke nobody (a datagram was lost): a round of Trio's loop would only come back here.
            self.current_time()
        if deadline == math.inf:
            self._polls += 1
            if self._polls <= POLLS_MAX:
                return 0.0
            self.fail(SimulationStuck(f"deadlock at {self.now:.6f} s: no task can run, and nothing will happen\n{who_waits()}"))
            self._break_off_if_hopeless(GRACE_STEPS)
            return 0.0
        if deadline > self._virtual_s_max and self._too_late(deadline):
            return 0.0
        self.now = max(self.now, deadline)
        self._polls = 0
        return 0.0

    # ---------------------------------------------------------------------------------------------------- limits

    def fail(self, error: BaseException) -> None:
        """End the simulation with this error (the first one counts)."""
        if self.failure is None:
            self.failure = error
            self._failed_at = self.steps
            self.main.cancel()

    def _too_late(self, when: float) -> bool:
        """True the first time; afterwards the tasks may use some more time for their end."""
        if self.failure is not None:
            return False
        self.fail(SimulationStuck(f"{self._virtual_s_max:g} virtual seconds are over (next: {when:.6f} s)\n{who_waits()}"))
        return True

    def _check_limits(self) -> None:
        if self.steps >= self._next_collection:
            self._next_collection = self.steps + COLLECT_STEPS
            gc.collect()
        if self.steps > self._steps_max:
            self.fail(SimulationStuck(f"{self._steps_max} steps were not enough (at {self.now:.6f} s)\n{who_waits()}"))
        if time.perf_counter() - self._wall_begin > self._wall_s_max:
            self.fail(SimulationStuck(f"{self._wall_s_max:g} real seconds were not enough (at {self.now:.6f} s)\n{who_waits()}"))
        self._break_off_if_hopeless(0)

    def _break_off_if_hopeless(self, more_steps: int) -> None:
        # Reached when tasks do not end though they are cancelled (a shield around a wait that nobody ends).
        self.steps += more_steps
        late = self.steps - self._failed_at
        if self.failure is None or late <= GRACE_STEPS:
            return
        if not self._shields_are_down:
            self._shields_are_down = True
            self.failure.add_note(f"afterwards tasks did not end when they were cancelled:\n{who_waits()}")
            _lower_shields()
        elif late > 3 * GRACE_STEPS:
            raise SimulationStuck(f"tasks do not end when they are cancelled\n{who_waits()}") from self.failure


def calls_wait(entries: EntryQueue) -> bool:
    """Something of Trio's own is to be called from its loop: generators that are left over are finalized this way."""
    return bool(entries.queue or entries.idempotent_queue)


def _wake(sleeper: list[Task]) -> None:
    """Nobody, if the sleep was cancelled meanwhile."""
    for task in sleeper:
        trio.lowlevel.reschedule(task)


def nanoseconds(seconds: float) -> float:
    """Rounded: that is fine enough, and hides the last digit of a library's arithmetic from the trace."""
    return round(seconds, 9)


def who_waits() -> str:
    """One line for each kind of task that has no children: its name, and the last place of its stack outside of Trio."""
    root = trio.lowlevel.current_root_task()
    kinds = Counter(f"  {task.name}: {_place_of(task)}" for task in _leaves(root)) if root is not None else Counter()
    lines = [f"{line} ({count} times)" if count > 1 else line for line, count in kinds.items()]
    more = [f"  ... and {len(lines) - WAITING_SHOWN_MAX} more"] if len(lines) > WAITING_SHOWN_MAX else []
    return "\n".join(["tasks:", *lines[:WAITING_SHOWN_MAX], *more])


def _lower_shields() -> None:
    """Let the cancellation of the main task reach every task: a shield protects an orderly end, and this is none."""
    root = trio.lowlevel.current_root_task()
    for task in list(_leaves(root)) if root is not None else []:
        status: CancelStatus | None = task._cancel_status
        while status is not None:
            status._scope.shield = False
            status = status._parent


def _leaves(task: Task) -> Iterator[Task]:
    children = sorted((child for nursery in task.child_nurseries for child in nursery.child_tasks), key=lambda child: child.name)
    if not children:
        yield task
    for child in children:
        yield from _leaves(child)


def _place_of(task: Task) -> str:
    place = "has not begun"
    for frame, line in task.iter_await_frames():
        name = frame.f_code.co_filename
        if "/trio/" not in name:
            place = f"{'/'.join(name.rsplit('/', 3)[-3:])}:{line} in {frame.f_code.co_name}"
    return place


def current_time_of_simulation() -> VirtualTime:
    """The clock of the simulation that this code runs in."""
    clock = trio.lowlevel.current_clock()
    assert isinstance(clock, VirtualTime), "a simulated world needs virtual time: run it with run_simulated"
    return clock
