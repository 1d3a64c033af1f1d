"""If one fails, a safeguard that only shows in time and on disks no longer guards, or guards nothing (see test_safeguards)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest
import trio

from scenefold.base.errors import Refused
from scenefold.base.location import WHOLE_LINE
from scenefold.base.reasons import RejectReason
from scenefold.peer.line import Side, giving, receiving
from scenefold.peer.line.adoption import Adoption
from scenefold.peer.line.giving import Giving
from scenefold.peer.line.holding import Handover, Holding
from scenefold.peer.line.parts import Parts
from scenefold.peer.timing import T_LEASE_S
from scenefold.world.sim import run_simulated
from unit.peer.line.bent import bend
from unit.peer.line.street import Street
from unit.peer.line.test_crashes import RECORDS, Story, adopting, end_of, handing_right, losing_the_receiver, play

pytestmark = pytest.mark.usefixtures("only_errors")

RATE_ERROR = 1.01
WRITERS = 16


def goes_badly(story: Story, founders: int = 2) -> None:
    with pytest.raises(BaseExceptionGroup) as caught:
        play(story, founders=founders)
    assert caught.group_contains(AssertionError)


def test_what_is_released_is_durable_at_the_receiver(monkeypatch: pytest.MonkeyPatch) -> None:
    play(handing_right)

    async def forget(_store: object, _puts: Sequence[object]) -> None:
        return None

    monkeypatch.setattr(receiving, "keep_durably", forget)
    goes_badly(handing_right)


def test_what_is_not_claimed_is_not_deleted(monkeypatch: pytest.MonkeyPatch) -> None:
    """The receiver dies for good between copy and claim: only the giver has the records then."""
    play(losing_the_receiver, founders=3)
    claim = Giving._claim

    async def delete_first(self: Giving, handover: Handover) -> None:
        store = self._parts.store
        manifest = await store.manifest(handover.piece, None, RECORDS)
        await store.remove([(entry.spot, entry.digest) for entry in manifest.entries])
        await claim(self, handover)

    monkeypatch.setattr(Giving, "_claim", delete_first)
    goes_badly(losing_the_receiver, founders=3)


def test_what_was_released_to_a_removed_node_is_taken_back_before_others_adopt_its_place(monkeypatch: pytest.MonkeyPatch) -> None:
    bend(monkeypatch, Holding, "drop_removed", "found.step is not Step.RELEASED and ", "")
    goes_badly(losing_the_receiver, founders=3)


def test_a_piece_is_taken_back_only_once_the_leases_of_the_removed_are_over(monkeypatch: pytest.MonkeyPatch) -> None:
    assert taken_back_after() >= T_LEASE_S * RATE_ERROR / (2 - RATE_ERROR), "by the fastest clock and the slowest"
    bend(monkeypatch, Giving, "_take_back", "parts.leases_end_in_s(removal.position)", "0.0")
    assert taken_back_after() < T_LEASE_S


def taken_back_after() -> float:
    """True seconds between the removal of a receiver and the taking back, by a giver whose clock is fast and that restarts meanwhile."""

    async def main() -> float:
        street = Street(3)
        async with trio.open_nursery() as nursery:
            await street.begin(nursery)
            giver = street.houses[0]
            street.net.machine(giver.address).clock.set_rate(RATE_ERROR)
            await losing_the_receiver(street)
            removed_at = street.net.now
            assert giver.durable().right is not None
            await trio.sleep(5.0)
            giver.crash()
            while giver.durable().right is not None:  # noqa: ASYNC110 - the disk is the truth
                await trio.sleep(0.1)
            nursery.cancel_scope.cancel()
            return street.net.now - removed_at

    return run_simulated(1, main, virtual_s_max=1000.0, wall_s_max=60.0)


def test_a_gap_is_adopted_only_once_the_leases_of_the_removed_are_over(monkeypatch: pytest.MonkeyPatch) -> None:
    assert adopted_after() >= T_LEASE_S * RATE_ERROR / (2 - RATE_ERROR), "by the fastest clock and the slowest"
    bend(monkeypatch, Adoption, "_wait_s", "if not registry.left_at:", "if True:")
    assert adopted_after() < T_LEASE_S


def adopted_after() -> float:
    """True seconds between a removal and the adoption of what the removed one owned, by a node whose clock is fast."""

    async def main() -> float:
        street = Street(3)
        async with trio.open_nursery() as nursery:
            await street.begin(nursery)
            street.net.machine(street.houses[2].address).clock.set_rate(RATE_ERROR)
            street.net.machine(street.houses[0].address).clock.set_rate(RATE_ERROR)
            await adopting(street)
            removed_at = street.net.now
            await street.until_whole()
            passed = street.net.now - removed_at
            nursery.cancel_scope.cancel()
        return passed

    return run_simulated(1, main, virtual_s_max=1000.0, wall_s_max=60.0)


@pytest.fixture
def without_leases(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Parts, "require_lease", lambda _self: None)


def outcome(giver_leased: bool, receiver_leased: bool) -> RejectReason | None:
    """How a handover ends when these hold their leases."""

    async def main() -> RejectReason | None:
        street = Street(2)
        async with trio.open_nursery() as nursery:
            await street.begin(nursery)
            await street.fill(0, RECORDS)
            giver, receiver = street.houses
            await trio.sleep(11.0)
            giver.leased, receiver.leased = giver_leased, receiver_leased
            reason = None
            try:
                line: Any = giver.line
                await line.give(Side.RIGHT, end_of(line.arc, Side.RIGHT, 0.5), why="a test")
            except Refused as refusal:
                reason = refusal.reason
            assert (receiver.durable().arc != WHOLE_LINE) and (reason is None) == (
                receiver.durable().arc.length > giver.durable().arc.length
            )
            nursery.cancel_scope.cancel()
        return reason

    return run_simulated(1, main, virtual_s_max=1000.0, wall_s_max=60.0)


@pytest.mark.parametrize(("giver", "receiver"), [(False, True), (True, False)])
def test_who_may_not_speak_for_its_arc_gives_and_takes_nothing(giver: bool, receiver: bool) -> None:
    assert outcome(giver, receiver) is RejectReason.NOT_READY


@pytest.mark.usefixtures("without_leases")
@pytest.mark.parametrize(("giver", "receiver"), [(False, True), (True, False)])
def test_and_it_is_the_lease_that_keeps_it_from_that(giver: bool, receiver: bool) -> None:
    assert outcome(giver, receiver) is None


def adopts_without_a_lease() -> bool:
    """Whether a node without a lease adopts the arc of a removed neighbour, or has its bound believed by others."""

    async def main() -> bool:
        street = Street(3)
        async with trio.open_nursery() as nursery:
            await street.begin(nursery)
            street.houses[2].leased = False
            await adopting(street)
            before = street.houses[2].durable().arc
            await trio.sleep(60.0)
            grown: bool = street.houses[2].durable().arc != before
            nursery.cancel_scope.cancel()
        return grown

    return run_simulated(1, main, virtual_s_max=1000.0, wall_s_max=60.0)


def test_nobody_adopts_without_a_lease() -> None:
    assert not adopts_without_a_lease()


@pytest.mark.usefixtures("without_leases")
def test_and_it_is_the_lease_that_keeps_it_from_adopting() -> None:
    assert adopts_without_a_lease()


def test_the_last_pass_runs_behind_a_flush_and_a_freeze(monkeypatch: pytest.MonkeyPatch) -> None:
    """A writer goes on writing new places into the piece while it is handed over."""
    play(writing_on)

    async def at_once(_self: Giving, *_about: object) -> bool:
        return True

    monkeypatch.setattr(Giving, "_complete", at_once)
    goes_badly(writing_on)


async def writing_on(street: Street) -> None:
    await street.fill(0, RECORDS)
    house = street.houses[0]
    async with trio.open_nursery() as nursery:

        async def write(number: int) -> None:
            while house.line is not None and house.line.arc is not None:
                number += WRITERS
                await street.write(0, number)
                await trio.sleep(0.001)

        await trio.sleep(11.0)
        for number in range(WRITERS):
            nursery.start_soon(write, number)
        with trio.move_on_after(60.0):
            await house.line.give(Side.RIGHT, end_of(house.line.arc, Side.RIGHT, 0.5), why="a test")  # type: ignore[union-attr, arg-type]
        nursery.cancel_scope.cancel()


assert giving.FREEZE_S_MAX < 2.0, "writers wait for 2 s"
