"""If this failed, who hangs up at once could keep a port busy with handshakes that never begin."""

from __future__ import annotations

from itertools import pairwise

import pytest
import trio
import trio.testing
from hypothesis import given
from hypothesis import strategies as st

from scenefold.world.real.handshake_turns import HandshakeTurns

GAP_S = 0.005
HONEST = -1


async def begun_at(turns: HandshakeTurns, name: int, begun: dict[int, float]) -> None:
    await turns.wait()
    begun[name] = trio.current_time()


async def test_those_that_wait_begin_one_after_the_other(autojump_clock: trio.testing.MockClock) -> None:
    turns, begun, start = HandshakeTurns(GAP_S), dict[int, float](), trio.current_time()
    async with trio.open_nursery() as nursery:
        for name in range(5):
            nursery.start_soon(begun_at, turns, name, begun)
            await trio.testing.wait_all_tasks_blocked()
    assert list(begun) == [0, 1, 2, 3, 4], "in the order in which they came"
    assert list(begun.values()) == pytest.approx([start + number * GAP_S for number in range(5)])


async def test_who_comes_to_an_idle_port_waits_for_nobody(autojump_clock: trio.testing.MockClock) -> None:
    turns = HandshakeTurns(GAP_S)
    for _ in range(3):
        began = trio.current_time()
        await turns.wait()
        assert trio.current_time() == began
        await trio.sleep(2 * GAP_S)


async def test_who_leaves_the_queue_takes_no_turn(autojump_clock: trio.testing.MockClock) -> None:
    turns, begun = HandshakeTurns(GAP_S), dict[int, float]()
    await turns.wait()
    began = trio.current_time()
    for crowd in range(100):
        with trio.CancelScope() as pushed_out:
            async with trio.open_nursery() as nursery:
                for name in range(64):
                    nursery.start_soon(begun_at, turns, 64 * crowd + name, begun)
                await trio.testing.wait_all_tasks_blocked()
                pushed_out.cancel()
    await begun_at(turns, HONEST, begun)
    assert list(begun) == [HONEST] and begun[HONEST] <= began + GAP_S


@given(st.lists(st.tuples(st.floats(0, 0.1), st.floats(0, 0.1)), max_size=30))
def test_whoever_comes_and_goes_when_turns_are_apart_and_none_is_wasted(visits: list[tuple[float, float]]) -> None:
    """`visits`: when each comes, and how long it waits."""
    begun = dict[int, float]()
    asked = dict[int, float]()
    left = dict[int, float]()

    async def visit(turns: HandshakeTurns, name: int, at: float, patience_s: float) -> None:
        await trio.sleep(at)
        asked[name] = trio.current_time()
        with trio.move_on_after(patience_s):
            await begun_at(turns, name, begun)
        left[name] = trio.current_time()

    async def main() -> None:
        turns = HandshakeTurns(GAP_S)
        async with trio.open_nursery() as nursery:
            for name, (at, patience_s) in enumerate(visits):
                nursery.start_soon(visit, turns, name, at, patience_s)

    trio.run(main, clock=trio.testing.MockClock(autojump_threshold=0))
    times = sorted(begun.values())
    assert all(later - earlier >= GAP_S - 1e-9 for earlier, later in pairwise(times))
    for name, at in begun.items():
        before = max((time for time in times if time < at), default=asked[name] - GAP_S)
        assert at <= max(asked[name], before + GAP_S) + 1e-9, "nobody waited for one that never began"
