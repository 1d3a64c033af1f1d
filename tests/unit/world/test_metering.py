"""If this fails, a peer is charged for others' requests, or not for all that its own cost."""

from __future__ import annotations

import types
from collections.abc import Awaitable, Callable, Generator
from types import SimpleNamespace

import pytest
import trio

from scenefold.base.errors import LocalFault
from scenefold.world import metering
from scenefold.world.guests import Guests
from scenefold.world.metering import FORGED_S, Bill, charge_forged, running_bill
from scenefold.world.turns import Turns


class Stopwatch:
    """Time that passes when a test says so."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now

    def work(self, seconds: float) -> None:
        self.now += seconds


class Till:
    def __init__(self) -> None:
        self.paid: list[float] = []

    @property
    def total(self) -> float:
        return sum(self.paid)


async def handled(till: Till, watch: Stopwatch | None, work: Callable[[], Awaitable[object]], estimate_s: float = 0.0) -> None:
    async def request() -> None:
        await work()

    bill = Bill(till.paid.append, watch, estimate_s)
    try:
        await bill.metered(request())
    finally:
        bill.close()


async def test_each_request_pays_for_its_own_moments_only() -> None:
    watch = Stopwatch()
    tills = [Till(), Till(), Till()]

    async def work(each_s: float) -> None:
        for _ in range(10):
            watch.work(each_s)
            await trio.lowlevel.checkpoint()

    async with trio.open_nursery() as nursery:
        for number, till in enumerate(tills):
            nursery.start_soon(handled, till, watch, lambda number=number: work(0.001 * number))
    assert [till.total for till in tills] == pytest.approx([0.0, 0.01, 0.02])


async def test_what_is_raised_and_what_is_returned_passes_through() -> None:
    watch, till = Stopwatch(), Till()

    async def fails() -> None:
        watch.work(0.5)
        try:
            await trio.lowlevel.checkpoint()
        finally:
            raise LocalFault("no")

    with pytest.raises(LocalFault):
        await handled(till, watch, fails)

    async def seven() -> int:
        await trio.lowlevel.checkpoint()
        return 7

    assert await Bill(till.paid.append, watch).metered(seven()) == 7
    assert till.total == 0.5


async def test_a_request_that_is_cancelled_pays_for_what_it_has_cost() -> None:
    watch, till = Stopwatch(), Till()

    async def sleeps() -> None:
        watch.work(0.25)
        try:
            await trio.sleep_forever()
        finally:
            watch.work(0.25)

    async with trio.open_nursery() as nursery:
        nursery.start_soon(handled, till, watch, sleeps)
        await trio.testing.wait_all_tasks_blocked()
        nursery.cancel_scope.cancel()
    assert till.total == 0.5


async def test_the_estimate_is_paid_at_once_and_is_the_least() -> None:
    watch, till = Stopwatch(), Till()
    bill = Bill(till.paid.append, watch, 0.01)
    assert till.total == 0.01
    bill.spend(0.004)
    bill.close(0.02)
    assert till.total == pytest.approx(0.03)
    bill = Bill(till.paid.append, watch, 0.01)
    bill.spend(0.05)
    bill.close(0.02)
    assert till.total == pytest.approx(0.08), "the estimates are in it"


async def test_without_a_stopwatch_estimates_and_charges_are_paid() -> None:
    till = Till()

    async def forges() -> None:
        charge_forged(500)
        await trio.lowlevel.checkpoint()

    await handled(till, None, forges, 0.01)
    assert till.total == 500 * FORGED_S


async def test_what_worker_threads_do_for_a_request_is_on_its_bill_and_nothing_outside() -> None:
    watch, till = Stopwatch(), Till()

    async def verifies() -> None:
        bill = running_bill()
        assert bill is not None
        await trio.to_thread.run_sync(bill.in_thread, sum, range(300_000))

    async with trio.open_nursery() as nursery:
        nursery.start_soon(handled, till, watch, verifies)
    assert till.total > 0
    assert running_bill() is None
    charge_forged(1)


async def test_what_is_little_is_paid_together_and_what_is_much_before_the_end() -> None:
    till = Till()
    bill = Bill(till.paid.append, None)
    for spent_s, paid in ((0.0006, []), (0.0006, [0.0012]), (0.0004, [0.0012]), (0.5, [0.0012, 0.5004])):
        bill.spend(spent_s)
        assert till.paid == pytest.approx(paid)
    bill.spend(0.0002)
    bill.close()
    bill.close()
    assert till.paid == pytest.approx([0.0012, 0.5004, 0.0002]), "and nothing twice"


async def test_what_has_cost_less_than_its_estimate_is_not_paid_back_and_nothing_is_lost_above_it() -> None:
    till = Till()
    bill = Bill(till.paid.append, None, 0.01)
    bill.spend(0.005)
    bill.close()
    assert till.paid == [0.01]
    bill = Bill(till.paid.append, None, 0.01)
    bill.spend(0.0105)
    bill.close()
    assert till.total == pytest.approx(0.0205)


async def test_one_forged_thing_costs_a_millisecond_more() -> None:
    till = Till()

    async def forges() -> None:
        charge_forged(1)
        await trio.lowlevel.checkpoint()

    async with trio.open_nursery() as nursery:
        nursery.start_soon(handled, till, None, forges)
    assert till.paid == [0.001]


async def test_a_request_hears_that_it_is_cancelled_and_may_clean_up() -> None:
    watch, till, heard = Stopwatch(), Till(), list[str]()

    async def cleans_up() -> None:
        try:
            await trio.sleep_forever()
        except trio.Cancelled:
            heard.append("cancelled")
            with trio.CancelScope(shield=True):
                await trio.lowlevel.checkpoint()
            heard.append("clean")
            raise

    async with trio.open_nursery() as nursery:
        nursery.start_soon(handled, till, watch, cleans_up)
        await trio.testing.wait_all_tasks_blocked()
        nursery.cancel_scope.cancel()
    assert heard == ["cancelled", "clean"]


async def test_a_thread_that_fails_is_paid_for_as_well(monkeypatch: pytest.MonkeyPatch) -> None:
    watch, till = Stopwatch(), Till()
    monkeypatch.setattr(metering, "time", SimpleNamespace(thread_time=watch))

    def fails() -> None:
        watch.work(0.25)
        raise LocalFault("no")

    bill = Bill(till.paid.append, watch)
    with pytest.raises(LocalFault):
        bill.in_thread(fails)
    bill.spend(0.0)
    assert till.paid == [0.25]


async def test_what_is_thrown_into_a_request_reaches_it_once() -> None:
    @types.coroutine
    def trap() -> Generator[str, None, None]:
        yield "waits"

    async def goes_on() -> str:
        try:
            await trap()
        except LocalFault:
            await trap()
        return "done"

    request = Bill(Till().paid.append, Stopwatch()).metered(goes_on())
    assert request.send(None) == "waits"
    assert request.throw(LocalFault("no")) == "waits"
    with pytest.raises(StopIteration, match="done"):
        request.send(None)


async def test_a_member_pays_for_what_is_measured_like_anybody() -> None:
    watch, till = Stopwatch(), Till()

    async def serves() -> None:
        watch.work(0.5)

    with Guests(Turns(lambda _peer: True), 0, watch).admitted("node:1") as (share, _scope):
        share._pay = till.paid.append  # type: ignore[method-assign]
        bill = share.bill()
        await bill.metered(serves())
        bill.close()
    assert till.total == 0.5
