"""If one fails, handovers and strays take more of the link than they were given, or much less."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from functools import partial
from itertools import accumulate
from typing import Any

import pytest
import trio
from hypothesis import given
from hypothesis import strategies as some

from scenefold.peer.line import Line, Side
from scenefold.peer.line.budget import BURST_S, Budget
from scenefold.store import Put
from scenefold.wire import CopyRecords, HandRecords
from scenefold.world.sim import SimNet, VirtualTime, run_on, run_simulated
from unit.peer.line import street as streets
from unit.peer.line.street import Asker, Street, places, record_at
from unit.peer.line.test_crashes import end_of

RATE = 1000.0
BURST = RATE * BURST_S
ROUNDING = 1e-6


def in_virtual_time(test: Callable[[], Awaitable[None]]) -> None:
    run_on(VirtualTime(virtual_s_max=1e6, wall_s_max=30.0), 1, test)


def a_budget() -> Budget:
    return Budget(SimNet(1).world("node:1", "10.0.0.1").clock, RATE)


async def seconds_of(budget: Budget, count: int) -> float:
    begin = trio.current_time()
    await budget.take(count)
    return trio.current_time() - begin


# ---------------------------------------------------------------------------------------------------------- the bucket


def test_a_burst_is_free_and_what_is_beyond_it_is_earned_first() -> None:
    async def test() -> None:
        budget = a_budget()
        assert await seconds_of(budget, int(BURST)) == 0
        assert await seconds_of(budget, 500) == pytest.approx(500 / RATE)
        assert await seconds_of(budget, 500) == pytest.approx(500 / RATE)

    in_virtual_time(test)


@pytest.mark.parametrize("idle_s", [0.25, 1.0, 3600.0])
def test_what_was_not_used_is_kept_for_a_second_at_most(idle_s: float) -> None:
    async def test() -> None:
        budget = a_budget()
        await budget.take(int(BURST))
        await trio.sleep(idle_s)
        earned = min(idle_s * RATE, BURST)
        assert await seconds_of(budget, 3 * int(BURST)) == pytest.approx((3 * BURST - earned) / RATE)

    in_virtual_time(test)


def test_more_than_a_burst_at_once_is_waited_for() -> None:
    async def test() -> None:
        budget = a_budget()
        assert await seconds_of(budget, 10 * int(BURST)) == pytest.approx(9 * BURST / RATE)
        assert await seconds_of(budget, 1) == pytest.approx(1 / RATE)

    in_virtual_time(test)


def test_a_debt_is_made_at_once_and_waited_off_by_the_next() -> None:
    async def test() -> None:
        budget = a_budget()
        begin = trio.current_time()
        budget.charge(5 * int(BURST))
        assert trio.current_time() == begin
        await trio.sleep(1.0)
        assert await seconds_of(budget, 1) == pytest.approx((4 * BURST + 1) / RATE - 1.0)

    in_virtual_time(test)


def test_another_rate_counts_at_once_and_also_for_those_who_wait() -> None:
    async def test() -> None:
        budget = a_budget()
        assert await seconds_of(budget, int(BURST)) == 0
        waited: list[float] = []

        async def wait() -> None:
            waited.append(await seconds_of(budget, 10**9))

        async with trio.open_nursery() as nursery:
            nursery.start_soon(wait)
            await trio.sleep(100.0)
            budget.bytes_per_s = 1e8
        assert waited[0] == pytest.approx(100.0 + (10**9 - 100 * RATE) / 1e8, abs=6.0)
        await trio.sleep(60.0)
        budget.bytes_per_s = 10.0
        assert await seconds_of(budget, 110) == pytest.approx(10.0), "what was saved up at a higher rate is a burst of the new one"

    in_virtual_time(test)


Step = tuple[float, int, bool]
steps = some.lists(some.tuples(some.floats(0, 5), some.integers(0, 4 * int(BURST)), some.booleans()), min_size=1, max_size=12)


@given(some.lists(steps, min_size=1, max_size=3))
def test_no_takers_together_pass_the_rate_and_none_waits_longer_than_it_must(takers: list[list[Step]]) -> None:
    async def test() -> None:
        budget, begin = a_budget(), trio.current_time()
        asked, due = 0.0, -BURST_S

        async def work(todo: list[Step]) -> None:
            nonlocal asked, due
            for pause_s, count, on_credit in todo:
                await trio.sleep(pause_s)
                # When the bucket would be at zero: what lay in it at most, and what flowed in since, is gone.
                now = trio.current_time() - begin
                due = max(due, now - BURST_S) + count / RATE
                asked, until, before = asked + count, due, asked + count
                if on_credit:
                    budget.charge(count)
                    continue
                await budget.take(count)
                at = trio.current_time() - begin
                assert before <= BURST + RATE * at + ROUNDING
                assert at == pytest.approx(max(now, until), abs=1e-6)

        async with trio.open_nursery() as nursery:
            for todo in takers:
                nursery.start_soon(work, todo)

    in_virtual_time(test)


# --------------------------------------------------------------------------------------------------------- a handover

LINK_BYTES_PER_S = 256 * 1024
RECORD_BYTES = 20_000
RECORDS = 240
STRAYS = 120


@dataclass
class Traffic:
    """When how many bytes of records left the first house."""

    sent: list[tuple[float, int, str]] = field(default_factory=list)

    def of(self, kind: str) -> int:
        return sum(count for _, count, what in self.sent if what == kind)


def watched(traffic: Traffic, clock: Callable[[], float]) -> type[Asker]:
    class Watched(Asker):
        async def ask(self, member: Any, priority: Any, packet: Any, answer: Any, timeout: float) -> Any:
            if isinstance(packet, CopyRecords | HandRecords):
                count = sum(len(item.header) + len(item.ciphertext) for item in packet.items)
                traffic.sent.append((clock(), count, type(packet).__name__))
            return await super().ask(member, priority, packet, answer, timeout)

    return Watched


def test_copies_and_strays_together_keep_to_the_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    traffic = Traffic()
    monkeypatch.setattr(streets, "Line", partial(Line, transfer_bytes_per_s=LINK_BYTES_PER_S))
    monkeypatch.setattr(streets, "RECORD_BYTES", RECORD_BYTES)

    async def main() -> None:
        street = Street(2)
        monkeypatch.setattr(streets, "Asker", watched(traffic, lambda: street.net.now))
        async with trio.open_nursery() as nursery:
            await street.begin(nursery)
            giver, receiver = street.houses
            await street.fill(0, RECORDS)
            await trio.sleep(11.0)
            await giver.store.merge([Put(record_at(place)) for place in places(receiver.durable().arc, STRAYS)])
            line: Any = giver.line
            begin = street.net.now
            await line.give(Side.RIGHT, end_of(line.arc, Side.RIGHT, 0.5), why="a test")
            await street.until_whole()
            street.check()
            nursery.cancel_scope.cancel()
        assert traffic.of("CopyRecords") >= RECORDS // 2 * RECORD_BYTES
        assert traffic.of("HandRecords") >= STRAYS * RECORD_BYTES
        times = [at - begin for at, _, _ in traffic.sent]
        for at, total in zip(times, accumulate(count for _, count, _ in traffic.sent), strict=True):
            assert total <= LINK_BYTES_PER_S * (at + BURST_S), f"too much within {at:.2f} s"
        whole = sum(count for _, count, _ in traffic.sent)
        assert max(times) <= 3 * whole / LINK_BYTES_PER_S, "most of the rate is used"
        kinds = [kind for _, _, kind in traffic.sent]
        assert kinds.index("HandRecords") < len(kinds) - 1 - kinds[::-1].index("CopyRecords"), "they were under way together"

    run_simulated(1, main, virtual_s_max=1000.0, wall_s_max=60.0)
