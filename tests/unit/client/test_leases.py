"""If this fails, a client signs an edit without a lease where participants decide, asks for one more often than it needs, or keeps one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import trio
from trio.testing import MockClock

from scenefold.base.errors import NoLease, Refused
from scenefold.base.limits import LEASE_LOOK_S
from scenefold.base.reasons import RejectReason
from scenefold.client import borrower
from scenefold.client.borrowing import IDLE_S, RENEW_S, REST_S
from scenefold.crypto import RecordHeader
from scenefold.wire import BorrowLease, LeaseUse, Packet, PutMany, SceneMode, SetMode
from scenefold.world import Priority, background_tasks
from scenefold.world.keyring import Keyring
from unit.client.fake_council import FIVE, FakeCouncil
from unit.client.fake_nodes import FakeNodes
from unit.client.test_participants import hall_of
from unit.client.test_spaces import BOX, scene_of

SLEPT_S = 3600.0
PLACES = [(0.1, 0.1, 0.1), (0.2, 0.2, 0.2), (0.9, 0.9, 0.9)]


def uses(council: FakeCouncil) -> list[LeaseUse]:
    return [packet.use for _, packet in council.borrowed]


def writes(council: FakeNodes) -> list[PutMany]:
    return [packet for _, packet in council.asked if isinstance(packet, PutMany)]


async def test_where_the_origin_decides_alone_nothing_is_borrowed(autojump_clock: MockClock, tmp_path: Path) -> None:
    nodes = FakeNodes()
    scene = await scene_of(nodes, tmp_path)
    await (await scene.create_space("hall", BOX)).put_at(PLACES[0], b"a chair")
    assert not [packet for _, packet in nodes.asked if isinstance(packet, BorrowLease)]


async def test_one_serves_many_writes_and_is_given_back_when_idle(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, space = await hall_of(council, tmp_path)
    async with background_tasks() as nursery:
        nursery.start_soon(scene.access.calls.leases.run)
        await trio.lowlevel.checkpoint()
        for place in PLACES:
            await space.put_at(place, b"a chair")
        await space.delete(await space.put_at(PLACES[0], b"a stool"))
        assert uses(council) == [LeaseUse.EDIT]
        await trio.sleep(IDLE_S + 0.1)
        assert uses(council) == [LeaseUse.EDIT, LeaseUse.GIVE_BACK] and len({address for address, _ in council.borrowed}) == 1
        await trio.sleep(60.0)
        assert len(council.borrowed) == 2, "who writes nothing asks for nothing"
        await space.put_at(PLACES[1], b"a table")
        assert uses(council)[2:] == [LeaseUse.EDIT]
    (first, *_), *_ = (packet.items for packet in writes(council))
    assert RecordHeader.decode(first.header).epoch >= 2, "the record shows that its author knows of what the lease is of"


class SlowDisks(FakeCouncil):
    """Writes take ten seconds, all else nothing."""

    async def request(self, address: str, priority: Priority, packet: Packet, timeout: float) -> Packet:
        if isinstance(packet, PutMany):
            await trio.sleep(10.0)
        return await super().request(address, priority, packet, timeout)


async def test_it_is_renewed_while_a_write_is_under_way(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = SlowDisks()
    scene, space = await hall_of(council, tmp_path)
    async with background_tasks() as nursery:
        nursery.start_soon(scene.access.calls.leases.run)
        await trio.lowlevel.checkpoint()
        await space.put_at(PLACES[0], b"a chair")
        assert uses(council) == [LeaseUse.EDIT] * 3, "every four seconds"
        await trio.sleep(IDLE_S + 0.1)
        assert uses(council)[3:] == [LeaseUse.EDIT, LeaseUse.GIVE_BACK], "at twelve, and when idle"


async def test_without_its_task_what_has_run_out_is_asked_for_anew(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, space = await hall_of(council, tmp_path)
    await space.put_at(PLACES[0], b"a chair")
    await trio.sleep(11.9)
    await space.put_at(PLACES[1], b"a chair")
    assert uses(council) == [LeaseUse.EDIT]
    await trio.sleep(0.2)
    await space.put_at(PLACES[2], b"a chair")
    assert uses(council) == [LeaseUse.EDIT] * 2
    await scene.access.calls.leases.close()
    assert uses(council)[-1] is LeaseUse.GIVE_BACK
    await scene.access.calls.leases.close()
    assert len(council.borrowed) == 3


async def test_a_minority_refuses_in_words_before_anything_is_sent(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    _, space = await hall_of(council, tmp_path)
    council.unlending = dict.fromkeys(FIVE, RejectReason.MODE_FORBIDS)
    began = trio.current_time()
    with pytest.raises(Refused, match="2 of them must hear each other") as told:
        await space.put_at(PLACES[0], b"a chair")
    assert told.value.reason is RejectReason.MODE_FORBIDS and "nothing was written" in told.value.remedy
    assert borrower.LEND_S_MAX <= trio.current_time() - began < borrower.LEND_S_MAX + 10.0
    assert not writes(council)
    council.unlending.clear()
    await space.put_at(PLACES[0], b"a chair")


async def test_who_has_no_lease_is_passed_over(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    _, space = await hall_of(council, tmp_path, 5)
    council.away = {FIVE[4]}
    council.unlending = {FIVE[0]: RejectReason.MODE_FORBIDS, FIVE[1]: RejectReason.NOT_READY, FIVE[3]: RejectReason.BUSY}
    await space.put_at(PLACES[0], b"a chair")
    assert council.borrowed[-1][0] == FIVE[2]


@pytest.mark.parametrize("reason", [RejectReason.BUSY, RejectReason.NOT_AUTHORISED])
async def test_another_reason_is_told_as_it_is(autojump_clock: MockClock, tmp_path: Path, reason: RejectReason) -> None:
    council = FakeCouncil()
    _, space = await hall_of(council, tmp_path)
    council.unlending = dict.fromkeys(FIVE, reason)
    with pytest.raises(Refused) as told:
        await space.put_at(PLACES[0], b"a chair")
    assert told.value.reason is reason and not writes(council)


async def test_each_of_those_that_lend_nothing_is_named_with_its_reason(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    _, space = await hall_of(council, tmp_path)
    council.unlending = {FIVE[0]: RejectReason.NOT_READY, FIVE[1]: RejectReason.MODE_FORBIDS, FIVE[2]: RejectReason.NOT_READY}
    with pytest.raises(NoLease) as told:
        await space.put_at(PLACES[0], b"a chair")
    assert told.value.where == f"scene kitchen; {FIVE[0]}, {FIVE[2]}: not ready; {FIVE[1]}: mode forbids"
    council.away = {FIVE[2]}
    council.unlending = {FIVE[0]: RejectReason.BUSY, FIVE[1]: RejectReason.BUSY}
    with pytest.raises(NoLease) as told:
        await space.put_at(PLACES[0], b"a chair")
    assert told.value.where == f"scene kitchen; {FIVE[0]}, {FIVE[1]}: busy; {FIVE[2]}: no answer"


async def test_a_participant_that_takes_no_part_any_more_says_nothing_of_the_writer(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    _, space = await hall_of(council, tmp_path)
    council.unlending = dict.fromkeys(FIVE, RejectReason.NOT_READY) | {FIVE[0]: RejectReason.NOT_AUTHORISED}
    with pytest.raises(Refused, match="lends a lease") as told:
        await space.put_at(PLACES[0], b"a chair")
    assert told.value.reason is RejectReason.MODE_FORBIDS and not writes(council)


async def test_in_render_mode_it_is_the_mode_that_is_told(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    _, space = await hall_of(council, tmp_path)
    await space.put_at(PLACES[0], b"a chair")
    other = await council.scenes(Keyring(tmp_path)).open("kitchen")
    await other.access.change_log(lambda _: SetMode(SceneMode.RENDER))
    before = len(writes(council))
    with pytest.raises(Refused, match="render mode"):
        await space.put_at(PLACES[1], b"a table")
    await trio.sleep(61.0)
    with pytest.raises(Refused, match="render mode"):
        await space.put_at(PLACES[1], b"a table")
    assert len(writes(council)) <= before + 1, "what was lent of before may still be signed under, and nodes refuse it"


async def test_what_is_asked_back_is_given_back_and_nobody_begins(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, space = await hall_of(council, tmp_path)
    async with background_tasks() as nursery:
        nursery.start_soon(scene.access.calls.leases.run)
        await trio.lowlevel.checkpoint()
        ended: list[float] = []

        async def write_on() -> None:
            for number in range(80):
                await space.put_at(((number + 0.5) / 80, 0.5, 0.5), b"a chair")
                ended.append(trio.current_time())
                await trio.sleep(0.1)

        nursery.start_soon(write_on)
        await trio.sleep(1.0)
        council.asking_back = set(FIVE)
        await trio.sleep(RENEW_S)
        assert uses(council)[-1] is LeaseUse.GIVE_BACK
        asked, told = len(council.borrowed), trio.current_time()
        council.asking_back = set()
        await trio.sleep(REST_S - 1.0)
        assert len(council.borrowed) == asked and ended[-1] < told
        await trio.sleep(2.0)
        assert uses(council)[-1] is LeaseUse.EDIT and ended[-1] > told + 1.0, "then all goes on"


async def test_what_was_signed_too_late_does_not_leave(autojump_clock: MockClock, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A computer that slept between the look at the lease and the signature."""
    council = FakeCouncil()
    scene, space = await hall_of(council, tmp_path)
    workers = scene.access.calls.world.workers
    run, slept = workers.run, []

    async def slow(lane: str, function: object, *arguments: object) -> object:
        if getattr(function, "__name__", "") == "seal_all" and not slept:
            slept.append(await trio.sleep(13.0))
        return await run(lane, function, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(workers, "run", slow)
    await space.put_at(PLACES[0], b"a chair")
    assert slept and uses(council) == [LeaseUse.EDIT] * 2 and len(writes(council)) == 1


async def test_an_answer_that_is_none_is_not_believed(autojump_clock: MockClock, tmp_path: Path) -> None:
    class Liars(FakeCouncil):
        def lend(self, address: str, packet: BorrowLease) -> Packet:
            lent = super().lend(address, packet)
            return replace(lent, **self.lies)  # type: ignore[arg-type]

        lies: dict[str, object] = {}  # noqa: RUF012 - set by the test

    for lies in ({"left_ms": 60_000}, {"is_active": False}, {"mode": SceneMode.RENDER}, {"nonce": 2**40}, {"lender": 7}, {"left_ms": 0}):
        council = Liars()
        folder = tmp_path / str(sorted(lies.items()))
        folder.mkdir()
        _, space = await hall_of(council, folder)
        council.lies = lies
        with pytest.raises(Refused) as told:
            await space.put_at(PLACES[0], b"a chair")
        assert told.value.reason is RejectReason.MODE_FORBIDS and not writes(council)


async def test_output_of_renders_needs_no_lease_for_edits(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, _ = await hall_of(council, tmp_path)
    images = await scene.create_space("images", BOX, render_output=True)
    council.unlending = dict.fromkeys(FIVE, RejectReason.MODE_FORBIDS)
    await scene.access.change_log(lambda _: SetMode(SceneMode.RENDER))
    await images.put_at(PLACES[0], b"an image")
    assert not uses(council)


async def test_who_renders_holds_one_until_the_image_is_there(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, _ = await hall_of(council, tmp_path)
    leases = scene.access.calls.leases
    async with leases.rendering(scene.access):
        assert not uses(council), "in edit mode there is nothing to hold"
    await scene.access.change_log(lambda _: SetMode(SceneMode.RENDER))
    async with background_tasks() as nursery:
        nursery.start_soon(leases.run)
        await trio.lowlevel.checkpoint()
        async with leases.rendering(scene.access):
            assert uses(council) == [LeaseUse.RENDER]
            council.asking_back = set(FIVE)
            await trio.sleep(60.0)
            assert len(uses(council)) == 15, "what has begun is renewed, whoever wants to edit"
        await trio.sleep(IDLE_S + 0.1)
        assert uses(council)[-1] is LeaseUse.GIVE_BACK


async def test_a_render_ends_when_its_lease_does(autojump_clock: MockClock, tmp_path: Path) -> None:
    council = FakeCouncil()
    scene, _ = await hall_of(council, tmp_path)
    await scene.access.change_log(lambda _: SetMode(SceneMode.RENDER))
    leases = scene.access.calls.leases
    async with background_tasks() as nursery:
        nursery.start_soon(leases.run)
        await trio.lowlevel.checkpoint()
        council.lent_ms = 11_000
        began = trio.current_time()

        async def render() -> None:
            async with leases.rendering(scene.access):
                council.away = set(FIVE)
                await trio.sleep(60.0)

        with pytest.raises(Refused, match="ran out") as told:
            await render()
        assert told.value.reason is RejectReason.MODE_FORBIDS and trio.current_time() - began == 11.0
        assert isinstance(told.value, NoLease) and told.value.was_held
        council.away = set()
        council.unlending = dict.fromkeys(FIVE, RejectReason.MODE_FORBIDS)
        with pytest.raises(NoLease, match="nothing was rendered"):
            async with leases.rendering(scene.access):
                raise AssertionError("nobody has lent anything")
    council.unlending.clear()
    with pytest.raises(ZeroDivisionError):
        async with leases.rendering(scene.access):
            raise ZeroDivisionError


async def test_after_a_sleep_of_the_machine_a_render_ends_within_a_second(
    autojump_clock: MockClock, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    council = FakeCouncil()
    scene, _ = await hall_of(council, tmp_path)
    await scene.access.change_log(lambda _: SetMode(SceneMode.RENDER))
    ended: list[float] = []

    async def render() -> None:
        try:
            async with scene.access.calls.leases.rendering(scene.access):
                await trio.sleep(0.3)
                monkeypatch.setattr(scene.access.calls.world.clock, "now", lambda: trio.current_time() + SLEPT_S)
                await trio.sleep(60.0)
        finally:
            ended.append(trio.current_time())

    began = trio.current_time()
    with pytest.raises(Refused, match="ran out"):
        await render()
    assert ended[0] - began <= 0.3 + LEASE_LOOK_S, "its clock went on while it slept, and Trio's did not"


async def test_an_image_that_is_done_before_the_end_of_its_lease_is_noticed_counts_for_nothing(
    autojump_clock: MockClock, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    council = FakeCouncil()
    scene, _ = await hall_of(council, tmp_path)
    await scene.access.change_log(lambda _: SetMode(SceneMode.RENDER))

    async def render() -> None:
        async with scene.access.calls.leases.rendering(scene.access):
            await trio.sleep(0.3)
            monkeypatch.setattr(scene.access.calls.world.clock, "now", lambda: trio.current_time() + SLEPT_S)
            await trio.sleep(LEASE_LOOK_S / 4)

    with pytest.raises(NoLease, match="ran out"):
        await render()
