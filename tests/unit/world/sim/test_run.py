"""If this failed, a mistake in a node would hang the simulation, or run differently every time."""

from __future__ import annotations

import gc
import math
import warnings
from collections.abc import Iterator

import pytest
import trio
import trio.testing

from scenefold.world.sim import SimulationStuck, run, run_simulated
from scenefold.world.sim.time import current_time_of_simulation


def test_hours_pass_in_no_time_and_the_result_comes_back() -> None:
    async def sleepy(answer: int) -> tuple[int, float]:
        await trio.sleep(50_000)
        return answer, trio.current_time()

    assert run_simulated(1, sleepy, 42) == (42, 50_000)


def test_what_the_program_raises_comes_out_as_it_is() -> None:
    async def fail() -> None:
        raise KeyError("mine")

    with pytest.raises(KeyError, match="mine"):
        run_simulated(1, fail)


def test_events_and_deadlines_happen_in_order() -> None:
    seen: list[str] = []

    async def main() -> None:
        time = current_time_of_simulation()
        time.after(3.0, seen.append, "event at 3")
        time.after(1.0, seen.append, "first event at 1")
        time.after(1.0, seen.append, "second event at 1")
        await trio.sleep(2.0)
        seen.append("sleep until 2")
        await trio.sleep(2.0)

    run_simulated(1, main)
    assert seen == ["first event at 1", "second event at 1", "sleep until 2", "event at 3"]


def test_a_deadlock_is_an_error_that_says_who_waits_where() -> None:
    async def waits_for_a_reply() -> None:
        await trio.Event().wait()

    async def main() -> None:
        async with trio.open_nursery() as nursery:
            for _ in range(3):
                nursery.start_soon(waits_for_a_reply)

    with pytest.raises(SimulationStuck, match=r"(?s)deadlock at 0.*waits_for_a_reply: .*test_run.py:\d+ in waits_for_a_reply \(3 times\)"):
        run_simulated(1, main)


def test_a_wait_that_cannot_even_be_cancelled_ends() -> None:
    async def main() -> None:
        with trio.CancelScope(shield=True):
            await trio.sleep_forever()

    with pytest.raises(SimulationStuck, match="deadlock") as caught:
        run_simulated(1, main)
    assert "did not end when they were cancelled" in caught.value.__notes__[0]


def test_virtual_time_is_bounded() -> None:
    async def main() -> None:
        while True:  # noqa: ASYNC110 - that it never ends is the point
            await trio.sleep(1)

    with pytest.raises(SimulationStuck, match="100 virtual seconds are over"):
        run_simulated(1, main, virtual_s_max=100)


def test_steps_are_bounded() -> None:
    async def main() -> None:
        while True:
            await trio.lowlevel.checkpoint()

    with pytest.raises(SimulationStuck, match="10000 steps were not enough"):
        run_simulated(1, main, steps_max=10_000)


def test_real_time_is_bounded() -> None:
    async def main() -> None:
        while True:
            await trio.lowlevel.checkpoint()

    with pytest.raises(SimulationStuck, match=r"0\.2 real seconds were not enough"):
        run_simulated(1, main, wall_s_max=0.2)


def test_an_event_that_is_due_again_and_again_is_found() -> None:
    async def main() -> None:
        time = current_time_of_simulation()

        def again() -> None:
            time.after(0.0, again)

        again()
        await trio.sleep(1)

    with pytest.raises(SimulationStuck, match="time stands still"):
        run_simulated(1, main)


def test_an_event_that_fails_ends_the_simulation() -> None:
    async def main() -> None:
        current_time_of_simulation().after(1.0, [].pop)
        await trio.sleep(2)

    with pytest.raises(IndexError):
        run_simulated(1, main)


def test_a_forgotten_coroutine_is_an_error() -> None:
    async def forgotten() -> None: ...

    async def main() -> None:
        forgotten()  # type: ignore[unused-coroutine]

    with pytest.raises(SimulationStuck, match=r"forgotten.*never awaited"):
        run_simulated(1, main)


def test_other_warnings_come_through() -> None:
    async def main() -> None:
        warnings.warn("mind the gap", UserWarning, stacklevel=1)

    with pytest.warns(UserWarning, match="mind the gap"):
        run_simulated(1, main)


def order_of_tasks(seed: int) -> list[int]:
    order: list[int] = []

    async def task(number: int) -> None:
        for _ in range(3):
            await trio.lowlevel.checkpoint()
            order.append(number)

    async def main() -> None:
        async with trio.open_nursery() as nursery:
            for number in range(10):
                nursery.start_soon(task, number)

    run_simulated(seed, main)
    return order


def test_the_order_of_tasks_comes_from_the_seed() -> None:
    assert order_of_tasks(1) == order_of_tasks(1) != order_of_tasks(2)


@pytest.fixture
def _unsettled(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """As in a process that does other things, too; what the tests' own process has frozen is frozen again afterwards."""
    monkeypatch.setattr(run, "_settled", [])
    gc.unfreeze()
    yield
    gc.freeze()


@pytest.mark.usefixtures("_unsettled")
def test_trio_and_the_collector_are_left_as_they_were() -> None:
    core = trio._core._run
    switch, dice, frozen = core._ALLOW_DETERMINISTIC_SCHEDULING, core._r.getstate(), gc.get_freeze_count()
    deadlines = trio.CancelScope._might_change_registered_deadline
    order_of_tasks(3)
    assert (core._ALLOW_DETERMINISTIC_SCHEDULING, core._r.getstate()) == (switch, dice)
    assert trio.CancelScope._might_change_registered_deadline is deadlines
    assert gc.isenabled() and gc.get_freeze_count() <= frozen


@pytest.mark.usefixtures("_unsettled")
def test_in_a_process_that_only_simulates_what_was_there_stays_frozen() -> None:
    run.settle()
    before = gc.get_freeze_count()
    order_of_tasks(3)
    assert gc.get_freeze_count() >= before > 0


def test_a_deadline_counts_as_it_was_last_set() -> None:
    async def main() -> list[float]:
        ends = []
        for first, then in ((1.0, 2.0), (2.0, 1.0), (math.inf, 1.0)):
            begin = trio.current_time()
            with trio.CancelScope(deadline=begin + first) as scope:
                scope.deadline = begin + then
                await trio.sleep_forever()
            ends.append(trio.current_time() - begin)
        with trio.move_on_after(1.0) as scope:
            scope.deadline = math.inf
            await trio.sleep(3.0)
        assert not scope.cancelled_caught
        return ends

    assert run_simulated(1, main) == [2.0, 1.0, 1.0]


def test_generators_are_finalized() -> None:
    ended = trio.Event()

    async def main() -> None:
        async def numbers():  # type: ignore[no-untyped-def]
            try:
                yield 1
            finally:
                with trio.CancelScope(shield=True):
                    await trio.lowlevel.checkpoint()
                ended.set()

        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ResourceWarning)
            async for _ in numbers():
                break
            await ended.wait()

    run_simulated(1, main)
    assert ended.is_set()


def test_silence_can_be_waited_for() -> None:
    async def main() -> float:
        async with trio.open_nursery() as nursery:
            nursery.start_soon(trio.sleep, 5)
            await trio.testing.wait_all_tasks_blocked()
            return trio.current_time()

    assert run_simulated(1, main) == 0.0
