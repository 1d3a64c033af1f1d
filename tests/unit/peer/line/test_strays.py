"""If one fails, one stray keeps all others from coming home, or ends the node that it lies at."""

from __future__ import annotations

import pytest
import trio

from scenefold.base.location import Location
from scenefold.peer.line import strays
from scenefold.peer.line.settling import SETTLING_S
from scenefold.store import Put
from scenefold.store.changes import storage_full
from scenefold.wire import HandItem, HandRecords, PutManyReply
from scenefold.world import Priority
from scenefold.world.sim import run_simulated
from unit.peer.line.street import HEADER, House, Street, places, record_at, rot
from unit.peer.scenes_made import SPACE

IN_HEADER, IN_BODY = 10, -1
"""A byte of each part of a stored record."""


async def begun(street: Street, nursery: trio.Nursery) -> list[House]:
    """The houses, once each has its arc."""
    await street.begin(nursery)
    while any(house.durable() is None for house in street.houses):  # noqa: ASYNC110 - a founding tells nobody
        await trio.sleep(0.1)
    return street.houses


def test_an_owner_that_is_silent_holds_up_its_own_strays_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(strays, "BATCH_RECORDS", 4)

    async def main() -> None:
        street = Street(3)
        async with trio.open_nursery() as nursery:
            await street.begin(nursery)
            holder, silent, other = street.houses
            while other.durable() is None:  # noqa: ASYNC110 - its founding tells nobody
                await trio.sleep(0.1)
            street.net.cut(holder.address, silent.address)
            theirs, others = places(silent.durable().arc, 40), places(other.durable().arc, 8)
            await holder.store.merge([Put(record_at(place)) for place in (*theirs, *others)])
            # It looks after a minute at the latest, and waits for the silent one once.
            await trio.sleep(100.0)
            assert other.stored() == set(others)
            street.net.mend(holder.address, silent.address)
            await street.until_whole()
            assert silent.stored() == set(theirs)
            nursery.cancel_scope.cancel()

    run_simulated(1, main, virtual_s_max=1000.0, wall_s_max=60.0)


@pytest.mark.expect_log("the disk is full|damaged|changed|rotten")
@pytest.mark.parametrize("byte", [IN_HEADER, IN_BODY], ids=["in the header", "in the body"])
def test_a_rotten_stray_on_a_full_disk_ends_nothing_and_holds_nobody_up(byte: int) -> None:
    async def main() -> None:
        street = Street(2)
        async with trio.open_nursery() as nursery:
            holder, other = await begun(street, nursery)
            rotten, *sound = places(other.durable().arc, 4)
            await holder.store.merge([Put(record_at(place)) for place in (rotten, *sound)])
            rot(holder, [rotten], byte)
            disk = street.net.machine(holder.address).disk
            disk.fill(0)
            await trio.sleep(100.0)
            assert holder.lives == 1, "it still runs"
            assert other.stored() == set(sound)
            assert holder.stored() == {rotten, *sound}, "nothing can be deleted"
            assert holder.line.events["strays stay: disk full"] > 1
            disk.fill(None)
            await trio.sleep(100.0)
            assert holder.stored() == set()
            assert holder.line.events["damaged strays discarded"] == 1
            nursery.cancel_scope.cancel()

    run_simulated(1, main, virtual_s_max=1000.0, wall_s_max=60.0)


def test_who_brings_the_same_again_and_again_keeps_nothing_from_being_given_away() -> None:
    async def main() -> None:
        street = Street(2)
        async with trio.open_nursery() as nursery:
            liar, owner = await begun(street, nursery)
            there, new = (await street.fill(1, 2))[:1], places(owner.durable().arc, 3)[1:2]
            await trio.sleep(SETTLING_S * 2)
            assert owner.line.settled(owner.line.arc)
            for places_brought, settled in ((there, True), (new, False), (new, False)):
                items = tuple(item_of(place) for place in places_brought)
                reply = await liar.line._parts.peers.ask(owner.node, Priority.LOW, HandRecords(items), PutManyReply, 5.0)
                assert [outcome.reason for outcome in reply.outcomes] == [0]
                assert owner.line.settled(owner.line.arc) is settled
                await trio.sleep(SETTLING_S * 0.8)
            assert owner.line.settled(owner.line.arc), "it was brought a second time"
            nursery.cancel_scope.cancel()

    run_simulated(1, main, virtual_s_max=1000.0, wall_s_max=60.0)


def item_of(place: Location) -> HandItem:
    record = record_at(place)
    return HandItem(HEADER.scene, SPACE, place, b"", record.signature, record.header_bytes, record.ciphertext)


def test_objects_that_cannot_slide_on_a_full_disk_hold_up_no_strays() -> None:
    async def main() -> None:
        street = Street(2)
        async with trio.open_nursery() as nursery:
            holder, other = await begun(street, nursery)

            async def parted(_piece: object) -> int:
                return 1

            async def slide(_parts: object) -> int:
                raise storage_full()

            holder.store.parted, holder.store.slide = parted, slide
            theirs = places(other.durable().arc, 4)
            await holder.store.merge([Put(record_at(place)) for place in theirs])
            await trio.sleep(100.0)
            assert other.stored() == set(theirs)
            assert holder.stored() == set()
            nursery.cancel_scope.cancel()

    run_simulated(1, main, virtual_s_max=1000.0, wall_s_max=60.0)
