"""If one fails, a holder whose disk is full is sent all that it is owed without end, or never again; or what makes room there does not come."""

from __future__ import annotations

from collections.abc import Sequence

import pytest
import trio

from scenefold.base.location import Location
from scenefold.base.reasons import RejectReason
from scenefold.crypto import Record
from scenefold.peer.replication.full_holders import AGAIN_S_MAX, AGAIN_S_MIN
from scenefold.peer.replication.paying_full import WASTED_BYTES_MAX, FullDisk
from scenefold.store import Outcome, Put, PutResult
from scenefold.wire import Packet, StoreCopies
from unit.peer.replication.terrace import Home, record_at
from unit.peer.replication.writers import Row, in_a_row, until

FULL = int(RejectReason.STORAGE_FULL)
LARGE = b"x" * 20_000


def test_it_is_tried_with_little_and_ever_more_seldom() -> None:
    disk = FullDisk()
    assert disk.packet_bytes(1 << 21) == 1 << 21
    pauses: list[float] = []
    for _ in range(7):
        disk.begin()
        disk.answered([WASTED_BYTES_MAX], [FULL])
        assert disk.has_refused and disk.is_hopeless
        assert disk.packet_bytes(1 << 21) == WASTED_BYTES_MAX
        pauses.append(disk.next_pause_s())
    assert pauses == [AGAIN_S_MIN, 60.0, 120.0, 240.0, 480.0, AGAIN_S_MAX, AGAIN_S_MAX]


def test_as_long_as_anything_is_taken_it_goes_on() -> None:
    disk = FullDisk()
    for _ in range(10):
        disk.answered([100, WASTED_BYTES_MAX - 100], [0, FULL])
        assert disk.has_refused and not disk.is_hopeless
    assert disk.next_pause_s() == AGAIN_S_MIN
    disk.begin()
    disk.answered([100], [0])
    assert not disk.has_refused
    assert disk.packet_bytes(1 << 21) == 1 << 21
    disk.answered([100], [int(RejectReason.NOT_MY_LOCATION)])
    assert not disk.has_refused


class Full:
    """A holder that has room only at some places. `came_bytes`: what it was sent."""

    def __init__(self, home: Home, monkeypatch: pytest.MonkeyPatch) -> None:
        self.open: set[Location] = set()
        self.is_full = True
        self.came_bytes = 0
        self._hold = home.store.hold
        monkeypatch.setattr(home.store, "hold", self._held)
        self._handler, senders = home.handlers._table[StoreCopies]
        home.handlers._table[StoreCopies] = self._counted, senders

    async def _counted(self, packet: StoreCopies, peer: str) -> Packet:
        self.came_bytes += sum(len(item.ciphertext) for item in packet.items)
        answer: Packet = await self._handler(packet, peer)
        return answer

    async def _held(self, puts: Sequence[Put]) -> list[PutResult]:
        if not self.is_full:
            return await self._hold(puts)
        results: list[PutResult] = []
        for put in puts:
            is_open = put.record.header.location in self.open
            results += await self._hold([put]) if is_open else [PutResult(Outcome.FULL)]
        return results


async def owing(row: Row, count: int) -> list[Record]:
    """The second holder lacks all of these, which are acknowledged."""
    await row.hold(1, 2)
    row.cut_off(2)
    records = [record_at(place, payload=LARGE) for place in row.places(count)]
    for start in range(0, count, 20):
        assert {outcome.reason for outcome in await row.put(*records[start : start + 20])} == {0}
    return records


def test_a_holder_whose_disk_is_full_is_not_sent_all_that_it_is_owed_again_and_again(monkeypatch: pytest.MonkeyPatch) -> None:
    async def story(row: Row) -> None:
        records = await owing(row, 60)
        late = row.homes[2]
        full = Full(late, monkeypatch)
        row.mend(2)
        await trio.sleep(300.0)
        # What was on its way or in memory, one packet more, and a few tries.
        assert len(LARGE) < full.came_bytes < 3 * 60 * len(LARGE)
        document = await row.owner.replication.health.document()
        assert document["full"] == [late.address]
        assert document["owed"]["nodes"] == [{"address": late.address, "records": 60, "alive": True}]
        full.is_full = False
        await until(lambda: all(map(late.has, records)) and not row.owner.debts(), AGAIN_S_MAX)

    in_a_row(story, seconds=2_000.0)


def test_what_makes_room_there_comes_though_what_is_before_it_does_not_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    """A deletion that is owed is one record among many, and nobody else can tell it from the others."""

    async def story(row: Row) -> None:
        records = await owing(row, 40)
        late = row.homes[2]
        full = Full(late, monkeypatch)
        full.open = {record.header.location for record in records[20::10]}
        row.mend(2)
        await until(lambda: all(map(late.has, records[20::10])), 2 * AGAIN_S_MAX)
        assert not late.has(records[0])

    in_a_row(story, seconds=2_000.0)
