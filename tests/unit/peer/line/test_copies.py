"""If one fails, a handover loses a record: one whose ciphertext lies at two places, or one that came while it went on."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import pytest
import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.location import Arc, Location
from scenefold.crypto import RECORD_DOMAIN, Record, RecordPlace
from scenefold.peer.line import Line, Side, copying
from scenefold.peer.line.receiving import Receiving
from scenefold.store import Put, Spot
from scenefold.wire import OfferRecords, Packet, RecordsWanted
from scenefold.world.sim import Point, run_simulated
from unit.peer.line.street import HEADER, Street, record_at, rot
from unit.peer.scenes_made import SPACE, WRITER


async def filled(street: Street, nursery: trio.Nursery, count: int) -> tuple[Line, list[Location], Location]:
    """The first house's line, records in its arc that have settled, and where the arc ends."""
    await street.begin(nursery)
    spots = await street.fill(0, count)
    await trio.sleep(11.0)
    giver = street.houses[0].line
    assert giver is not None and giver.arc is not None
    return giver, list(spots), giver.arc.last


def test_a_ciphertext_that_lies_at_two_places_is_copied_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(copying, "LIST_RECORDS_MAX", 4)

    async def main() -> None:
        street = Street(2)
        async with trio.open_nursery() as nursery:
            await street.begin(nursery)
            spots = await street.fill(0, 16)
            # A writer cannot open what it copies, but it can sign it for another place.
            victim = record_at(spots[-1])
            header = victim.header._replace(location=spots[8], seq=2).encode()
            forged = Record(header, WRITER.sign(RECORD_DOMAIN, header), victim.ciphertext)
            await street.houses[0].store.put([Put(forged)])
            await trio.sleep(11.0)
            giver = street.houses[0].line
            assert giver is not None and giver.arc is not None
            await giver.give(Side.RIGHT, Arc(spots[8], giver.arc.last), why="a test")
            await street.until_whole()
            street.check()
            nursery.cancel_scope.cancel()

    run_simulated(1, main, virtual_s_max=1000.0, wall_s_max=60.0)


def test_a_receiver_that_names_one_record_often_is_sent_it_once(monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = Receiving._on_list

    async def greedy(self: Receiving, packet: OfferRecords, peer: str) -> Packet:
        await wanted(self, packet, peer)
        return RecordsWanted(packet.handover, (0,) * 4096)

    async def main() -> None:
        street = Street(2)
        async with trio.open_nursery() as nursery:
            giver, spots, last = await filled(street, nursery, 16)
            await giver.give(Side.RIGHT, Arc(spots[-1], last), why="a test")
            assert giver.events["copied"] == 1
            nursery.cancel_scope.cancel()

    monkeypatch.setattr(Receiving, "_on_list", greedy)
    run_simulated(1, main, virtual_s_max=1000.0, wall_s_max=60.0)


@pytest.mark.expect_log("damaged|rotten|changed|its bytes are lost")
def test_what_had_rotted_and_is_whole_again_before_the_last_pass_goes_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """In the same version: somebody has brought a copy home meanwhile."""
    original = copying.Copier.copy
    mended: list[Location] = []

    async def main() -> None:
        street = Street(2)
        async with trio.open_nursery() as nursery:
            giver, spots, last = await filled(street, nursery, 16)
            store, place = street.houses[0].store, spots[-1]
            record = record_at(place)
            rot(street.houses[0], [place], -1)

            async def copy(self: copying.Copier, *, only: Sequence[Arc] | None = None, hurry: bool = False) -> copying.Pass:
                result = await original(self, only=only, hurry=hurry)
                if not hurry and not mended:
                    async with giver.writing([place]):
                        (kept,) = await store.merge([Put(record)])
                    assert kept.has_changed
                    mended.append(place)
                return result

            monkeypatch.setattr(copying.Copier, "copy", copy)
            await giver.give(Side.RIGHT, Arc(place, last), why="a test")
            await street.until_whole()
            assert mended
            (found,) = await street.houses[1].store.read([Spot(RecordPlace(HEADER.scene, SPACE, place))])
            assert isinstance(found, Record) and found.header == record.header
            nursery.cancel_scope.cancel()

    run_simulated(1, main, virtual_s_max=1000.0, wall_s_max=60.0)


@pytest.mark.parametrize("anywhere", [False, True])
def test_what_is_written_while_a_piece_goes_goes_with_it(monkeypatch: pytest.MonkeyPatch, anywhere: bool) -> None:
    looked_at: list[Sequence[Arc] | None] = []
    original = copying.Copier.copy

    async def copy(self: copying.Copier, *, only: Sequence[Arc] | None = None, hurry: bool = False) -> copying.Pass:
        if hurry:
            looked_at.append(only)
        result = await original(self, only=only, hurry=hurry)
        # Somebody writes behind every pass, at places that it has seen already.
        await trio.sleep(0.2)
        return result

    monkeypatch.setattr(copying.Copier, "copy", copy)

    async def main() -> None:
        street = Street(2)
        async with trio.open_nursery() as nursery:
            giver, spots, last = await filled(street, nursery, 200)
            store, piece = street.houses[0].store, Arc(spots[100], last)
            written: dict[Location, int] = {}

            async def write() -> None:
                seq = 1
                while True:
                    seq += 1
                    for place in spots[101:104]:
                        ends = [giver.arc.first, giver.arc.last] if anywhere else []
                        async with giver.writing([place, *ends]):
                            if not giver.owns(place):
                                return
                            await store.put([Put(record_at(place, seq % 250))])
                            written[place] = seq % 250
                    await trio.sleep(0.05)

            nursery.start_soon(write)
            await giver.give(Side.RIGHT, piece, why="a test")
            await street.until_whole()
            street.check()
            found = await street.houses[1].store.read([Spot(RecordPlace(HEADER.scene, SPACE, place)) for place in written])
            assert [record.header.seq for record in found] == list(written.values())
            nursery.cancel_scope.cancel()

    run_simulated(1, main, virtual_s_max=1000.0, wall_s_max=60.0)
    assert looked_at
    if anywhere:
        assert looked_at[-1] is not None and looked_at[-1][0].length > 1
    else:
        assert looked_at[-1] is not None and len(looked_at[-1]) == 3


@pytest.mark.expect_log("was reset by the peer|the connection was cut")
def test_nothing_is_released_to_a_receiver_whose_disk_was_wiped_after_it_had_answered() -> None:
    async def main() -> None:
        street = Street(2)
        async with trio.open_nursery() as nursery:
            await street.begin(nursery)
            spots = await street.fill(0, 16)
            await trio.sleep(11.0)
            giver, receiver = street.houses
            line = giver.line
            assert line is not None and line.arc is not None
            street.net.trap(receiver.address, Point.AFTER_COMMIT, 1, giver.crash)
            nursery.start_soon(attempt, line, Arc(spots[8], line.arc.last))
            # It was noted; the giver goes on after its restart, copies, and waits until its arc has settled.
            while not set(spots[8:]) <= receiver.stored():  # noqa: ASYNC110 - disks tell nobody when they change
                await trio.sleep(0.5)
            receiver.crash()
            street.net.machine(receiver.address).disk.wipe()
            await trio.sleep(20.0)
            assert giver.durable().owns(spots[8])
            nursery.cancel_scope.cancel()

    run_simulated(1, main, virtual_s_max=1000.0, wall_s_max=60.0)


async def attempt(line: Line, piece: Arc) -> None:
    with suppress(Refused, Unreachable, PeerFault):
        await line.give(Side.RIGHT, piece, why="a test")
