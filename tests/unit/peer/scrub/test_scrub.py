"""If this failed, rot would be found once it is too late, or looking for it would keep a node from its work."""

from __future__ import annotations

from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager

import pytest
import trio
import trio.testing
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.location import Arc
from scenefold.base.reasons import RejectReason
from scenefold.crypto import Record
from scenefold.peer.scrub import Pace, Scrub
from scenefold.peer.scrub.note import TOLD_MAX, decode_round, encode_round
from scenefold.peer.scrub.pace import DAY_S, LEAST_BYTES, REST_S, Round
from scenefold.peer.scrub.scrub import BATCH_RECORDS, NOTE_S, START_S
from scenefold.store import Entry, Manifest, Spot, StoreStatistics
from scenefold.store.layout import record_key, spot_of
from unit.store.samples import place, record

MIB = 1 << 20
KEYS = st.binary(min_size=26, max_size=26) | st.binary(min_size=42, max_size=42)
COUNTS = st.integers(0, (1 << 63) - 1)


class TrioTime:
    """Port `Clock`, of the test's own time."""

    stopwatch = None

    def now(self) -> float:
        return trio.current_time()

    def wall(self) -> float:
        raise AssertionError("a scrub has no use for the time of day")

    async def sleep(self, seconds: float) -> None:
        await trio.sleep(seconds)


class Shelf:
    """A store of records of one size; some have rotted, the headers of some of these as well."""

    def __init__(self, count: int, size: int) -> None:
        self.keys = [record_key(place(number)) for number in range(count)]
        self.size = size
        self.rotten: set[bytes] = set()
        self.headless: set[bytes] = set()
        self.read_at: list[tuple[float, bytes]] = []
        self.notes: dict[str, bytes] = {}
        self.written: list[float] = []
        self.is_full = False

    async def manifest(self, _where: Arc, after: bytes | None, limit: int, /) -> Manifest:
        found = [key for key in self.keys if after is None or key > after][:limit]
        entries = [Entry(*spot_of(key), b"", self.size) for key in found if key not in self.headless]
        damaged = tuple(spot_of(key) for key in found if key in self.headless)
        return Manifest(entries, found[-1] if len(found) == limit else None, damaged)

    async def read(self, spots: Sequence[Spot], /) -> list[Record | DamagedData | None]:
        keys = [record_key(*spot) for spot in spots]
        self.read_at += [(trio.current_time(), key) for key in keys]
        return [DamagedData("rotten") if key in self.rotten | self.headless else record(0) for key in keys]

    async def statistics(self) -> StoreStatistics:
        return StoreStatistics(len(self.keys), len(self.keys) * self.size, {}, 0, 0)

    async def get_note(self, name: str, /) -> bytes | None:
        return self.notes.get(name)

    async def put_note(self, name: str, value: bytes, /) -> None:
        if self.is_full:
            raise Refused(RejectReason.STORAGE_FULL, "no room")
        self.notes[name] = value
        self.written.append(trio.current_time())


@asynccontextmanager
async def scrubbing(shelf: Shelf, pace: Pace) -> AsyncIterator[Scrub]:
    scrub = Scrub(TrioTime(), shelf, pace)
    async with trio.open_nursery() as nursery:
        nursery.start_soon(scrub.run)
        yield scrub
        nursery.cancel_scope.cancel()


# --------------------------------------------------------------------------------------------------------------- pace


@given(total=st.integers(0, 1 << 50), days=st.floats(0.01, 365), bound=st.integers(1, 1 << 30))
def test_a_round_lasts_so_many_days_or_longer_if_that_needs_too_many_bytes_a_second(total: int, days: float, bound: int) -> None:
    rate = Pace(days, bound).rate(total)
    assert 0 < rate <= bound
    if rate < bound:
        assert total / rate <= days * DAY_S * 1.000001
    assert rate == bound or rate >= LEAST_BYTES / REST_S


@given(sizes=st.lists(st.integers(1_000, 60_000), min_size=1, max_size=40))
def test_batch_by_batch_a_round_is_done_in_its_time(sizes: list[int]) -> None:
    pace, total = Pace(30, 16 * MIB), sum(sizes) * 1_000_000
    pauses = [pace.pause_s(size * 1_000_000, total, is_round_over=False) for size in sizes]
    assert sum(pauses) == pytest.approx(30 * DAY_S)


def test_progress_tells_how_long_the_rest_takes() -> None:
    pace = Pace(30, 16 * MIB)
    half = Round(number=3, after=b"k", read_bytes=30_000 * MIB, rotten=2, rotten_before=1)
    told = half.progress(pace, 60_000 * MIB, paused=False)
    assert (told.round, told.fraction, told.rotten, told.rotten_before) == (3, 0.5, 2, 1)
    assert told.seconds_left == pytest.approx(15 * DAY_S) and told.bytes_per_s == pytest.approx(60_000 * MIB / 30 / DAY_S)
    assert Round().progress(pace, 0, paused=True).fraction == 0.0
    assert Round(read_bytes=9).progress(pace, 3, paused=True).fraction == 1.0, "what was read may be deleted by now"


# --------------------------------------------------------------------------------------------------------------- note


@given(
    st.builds(
        Round,
        number=st.integers(1, 1 << 40),
        after=st.none() | KEYS,
        read_bytes=COUNTS,
        records=COUNTS,
        rotten=COUNTS,
        rotten_before=COUNTS,
        told=st.lists(KEYS, max_size=5).map(tuple),
    )
)
def test_the_note_survives_its_bytes(found: Round) -> None:
    assert decode_round(encode_round(found)) == found


@given(st.binary(max_size=100))
def test_what_is_no_note_is_said_to_be_none(note: bytes) -> None:
    with pytest.raises(DamagedData):
        decode_round(note)


@pytest.mark.parametrize(
    "found",
    [Round(number=0), Round(after=b"short"), Round(read_bytes=-1), Round(told=(b"short",)), Round(told=(bytes(26),) * (TOLD_MAX + 1))],
)
def test_a_note_that_cannot_be_is_none(found: Round) -> None:
    with pytest.raises(DamagedData):
        decode_round(encode_round(found))


# ------------------------------------------------------------------------------------------------------------- reading


async def test_all_records_are_read_at_a_set_pace_and_then_again(autojump_clock: trio.testing.MockClock) -> None:
    shelf = Shelf(30 * BATCH_RECORDS + 5, 60_000)
    begin = trio.current_time()
    async with scrubbing(shelf, Pace(1, 16 * MIB)) as scrub:
        await trio.sleep(START_S - 1)
        assert shelf.read_at == [], "a node that has just started has better things to do"
        await trio.sleep(DAY_S / 2)
        told = scrub.progress((await shelf.statistics()).bytes)
        assert told.fraction == pytest.approx(0.5, abs=0.1) and told.round == 1
        await trio.sleep(DAY_S / 2 + REST_S)
    read = [key for _, key in shelf.read_at]
    assert read[: len(shelf.keys)] == shelf.keys and read[len(shelf.keys) :] == shelf.keys[: len(read) - len(shelf.keys)]
    last = next(when for when, key in shelf.read_at if key == shelf.keys[-1])
    assert last - begin - START_S == pytest.approx(DAY_S, rel=0.05)


async def test_no_more_bytes_a_second_than_it_may(autojump_clock: trio.testing.MockClock) -> None:
    shelf = Shelf(1000, 60_000)
    async with scrubbing(shelf, Pace(0.0001, 100_000)):
        await trio.sleep(START_S + 100)
    assert len(shelf.read_at) * 60_000 <= 100 * 100_000 + BATCH_RECORDS * 60_000
    assert len(shelf.read_at) * 60_000 >= 90 * 100_000


async def test_a_store_of_a_few_records_is_not_read_all_the_time(autojump_clock: trio.testing.MockClock) -> None:
    shelf = Shelf(3, 60)
    async with scrubbing(shelf, Pace(30, 16 * MIB)):
        await trio.sleep(START_S + 10.5 * REST_S)
    assert len(shelf.read_at) == 11 * 3 and len(shelf.written) == 11


async def test_what_has_rotted_is_read_as_any_reader_does_and_counted(autojump_clock: trio.testing.MockClock) -> None:
    shelf = Shelf(100, 6_000)
    shelf.rotten, shelf.headless = {shelf.keys[3], shelf.keys[70]}, {shelf.keys[71]}
    async with scrubbing(shelf, Pace(0.01, 16 * MIB)) as scrub:
        await trio.sleep(START_S + 0.02 * DAY_S)
        assert scrub.found == 3
        assert scrub.progress(1).rotten_before == 3 and scrub.progress(1).rotten == 0
    # A store tells of what it is asked for; a list without the headless ones would not do.
    assert sorted(key for _, key in shelf.read_at) == shelf.keys


async def test_it_can_be_paused(autojump_clock: trio.testing.MockClock) -> None:
    shelf = Shelf(1000, 60_000)
    async with scrubbing(shelf, Pace(30, MIB)) as scrub:
        scrub.pause()
        scrub.pause()
        await trio.sleep(10 * DAY_S)
        assert shelf.read_at == [] and scrub.is_paused and scrub.progress(1).paused
        scrub.resume()
        await trio.sleep(1 * DAY_S)
        assert shelf.read_at and not scrub.is_paused


async def test_another_rate_counts_also_for_a_rest_that_has_begun(autojump_clock: trio.testing.MockClock) -> None:
    shelf = Shelf(1000, 60_000)
    async with scrubbing(shelf, Pace(0.0001, 1)) as scrub:
        await trio.sleep(START_S + DAY_S)
        assert len(shelf.read_at) == BATCH_RECORDS, "the rest would last for weeks"
        scrub.bytes_per_s_max = 100_000
        assert scrub.bytes_per_s_max == scrub.progress(len(shelf.keys) * 60_000).bytes_per_s == 100_000
        await trio.sleep(200)
        assert len(shelf.read_at) >= 3 * BATCH_RECORDS


async def test_a_restart_goes_on_where_it_was(autojump_clock: trio.testing.MockClock) -> None:
    shelf, pace = Shelf(1000, 60_000), Pace(1, 16 * MIB)
    async with scrubbing(shelf, pace):
        await trio.sleep(START_S + DAY_S / 2)
    before, shelf.read_at = len(shelf.read_at), []
    async with scrubbing(shelf, pace):
        await trio.sleep(START_S + 60)
    again = shelf.keys.index(shelf.read_at[0][1])
    assert 0 <= before - again <= NOTE_S / DAY_S * 1000 + 2 * BATCH_RECORDS, "only what came since the last note is read twice"
    assert min(late - early for early, late in zip(shelf.written, shelf.written[1:], strict=False)) >= NOTE_S


async def test_what_was_told_to_have_rotted_is_read_at_once_and_once(autojump_clock: trio.testing.MockClock) -> None:
    shelf, found = Shelf(1000, 60_000), list[int]()
    told = shelf.keys[500], shelf.keys[600]
    shelf.rotten = {told[0]}
    shelf.notes["scrub"] = encode_round(Round(told=told))
    for _ in range(2):
        async with scrubbing(shelf, Pace(300, 16 * MIB)) as scrub:
            await trio.sleep(START_S + 60)
            found.append(scrub.found)
    read = [key for _, key in shelf.read_at]
    assert read[:2] == list(told) and not set(told) & set(read[2:]) and len(read) > 2 * BATCH_RECORDS
    assert found == [1, 0], "the other one was healed meanwhile"


@pytest.mark.expect_log("from the first on")
async def test_a_note_that_is_none_costs_a_round(autojump_clock: trio.testing.MockClock) -> None:
    shelf = Shelf(10, 60_000)
    shelf.notes["scrub"] = b"what is this"
    async with scrubbing(shelf, Pace(1, MIB)):
        await trio.sleep(START_S + 1)
    assert [key for _, key in shelf.read_at] == shelf.keys


async def test_a_full_disk_is_read_all_the_same(autojump_clock: trio.testing.MockClock) -> None:
    shelf = Shelf(10, 60_000)
    shelf.is_full = True
    async with scrubbing(shelf, Pace(1, MIB)):
        await trio.sleep(START_S + 5 * REST_S)
    assert len(shelf.read_at) > 20
