"""If this fails, the report of reads in bad weather counts what it should not, or a slow disk is not slow."""

from __future__ import annotations

import math
import time
from collections.abc import AsyncIterator, Iterator, Sequence
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import trio
from trio.testing import MockClock

from scenectl import bench_weather, slow_node
from scenectl.bench_weather import CALM, READ_S_MAX, READS_PER_S, Reader, weather_text
from scenefold.base.errors import Unreachable
from unit.client.test_cluster_health import LACKING, copies
from unit.client.test_health import ADDRESSES, arc, report


async def test_reads_begin_when_they_are_due_and_waiting_in_line_counts(autojump_clock: MockClock) -> None:
    lane = trio.CapacityLimiter(1)

    async def check(_numbers: object) -> None:
        async with lane:
            await trio.sleep(2 / READS_PER_S)

    reader = Reader(check, range(10))
    async with trio.open_nursery() as reads:
        with trio.move_on_after(4.0):
            await reader.run(reads)
    assert 3 * READS_PER_S < len(reader.waits_s) < 5 * READS_PER_S
    assert max(reader.waits_s) > 3.0, "twice as much was asked for as there is time for"


async def test_what_fails_or_never_ends_is_no_read(autojump_clock: MockClock) -> None:
    async def check(numbers: object) -> None:
        if sum(numbers) % 2:  # type: ignore[call-overload]
            raise Unreachable("it is away")
        await trio.sleep(READ_S_MAX + 1)

    reader = Reader(check, range(10))
    async with trio.open_nursery() as reads:
        with trio.move_on_after(1.0):
            await reader.run(reads)
    assert not reader.waits_s
    assert set(reader.failures) == {"it is away", f"no answer within {READ_S_MAX:g} s"}


def test_phases_of_one_name_are_one_and_all_are_held_against_calm() -> None:
    storm = bench_weather._Storm(None, None)  # type: ignore[arg-type]
    for name, wait_s in ((CALM, 0.01), ("slow disk", 0.02), (CALM, 0.01), ("repair", 0.0)):
        reader = Reader(None, ())  # type: ignore[arg-type]
        reader.waits_s = [wait_s] * 100 if wait_s else []
        storm._phases.append((name, reader, 5.0))
    report = storm.report()
    calm, slow, repair = report["phases"]
    assert (calm["phase"], calm["reads"], calm["seconds"], calm["of_calm"]) == (CALM, 200, 10.0, 1.0)
    assert slow["of_calm"] == pytest.approx(2.0)
    assert (repair["p99_ms"], repair["of_calm"]) == (None, None)
    assert "slow disk" in weather_text(report) and "2.0" in weather_text(report)


def test_the_disk_is_as_slow_as_the_file_beside_it_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Environment:
        @contextmanager
        def read(self) -> Iterator[str]:
            yield "seen"

        def update(self, change: str) -> str:
            return change

    monkeypatch.setattr(slow_node, "LmdbEnvironment", Environment)
    slept: list[float] = []
    monkeypatch.setattr(time, "sleep", slept.append)
    file = slow_node.slow_file_of(tmp_path / "data" / "127.0.0.2")
    slow_node.slow_down(file)

    def use() -> None:
        with Environment().read() as seen:
            assert seen == "seen"
        assert Environment().update("done") == "done"

    use()
    assert not slept
    file.parent.mkdir()
    file.write_text("0.25")
    use()
    assert slept == [0.25, 0.25]
    file.unlink()
    use()
    assert len(slept) == 2


# ----------------------------------------------------------------------------------------------------------- all of it

READ_S = {"": 0.001, "slow": 0.005, "dead": 0.003, "mending": 0.002, "coming": 0.004}
"""What a read takes, by what is amiss."""
REMOVED_S, MENDED_S, CAME_S = 20.0, 15.0, 10.0
OWNED = 60
"""Records, of two nodes or three."""


class Village:
    """Nodes as `weather` sees them, of which it has one suffer, records that are read from them, and what they report."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.profile, self.addresses = folder, folder / "profile", ADDRESSES
        self.killed_at = self.started_at = math.inf
        self.written: dict[int, int] = {}
        for address in self.addresses:
            (folder / "data" / address).mkdir(parents=True)

    @property
    def amiss(self) -> str:
        now, victim = trio.current_time(), self.addresses[-1]
        if now >= self.started_at:
            return "coming" if now < self.started_at + CAME_S else ""
        if now >= self.killed_at:
            return "dead" if now < self.killed_at + REMOVED_S else "mending" if now < self.killed_at + REMOVED_S + MENDED_S else ""
        return "slow" if slow_node.slow_file_of(self.folder / "data" / victim).exists() else ""

    # As LocalCluster.

    async def kill(self, address: str) -> None:
        assert address == self.addresses[-1] and not self.amiss
        self.killed_at = trio.current_time()

    def start(self, address: str) -> None:
        assert address == self.addresses[-1] and not self.amiss and not (self.folder / "data" / address).exists()
        self.started_at = trio.current_time()

    # As StoreWork.

    async def write(self, records: int, _seconds: float) -> None:
        self.written = {bench_weather.FIRST + number: 0 for number in range(records)}

    async def check(self, numbers: Sequence[int]) -> None:
        for number in numbers:
            self.written[number] += 1
        if self.amiss == "dead" and not numbers[0] % 4:
            raise Unreachable("it is away")
        await trio.sleep(READ_S[self.amiss])

    # As Cluster.

    async def nodes(self) -> list[Any]:
        is_there = math.isinf(self.killed_at) or self.amiss == "dead" or not math.isinf(self.started_at)
        there = self.addresses if is_there else self.addresses[:-1]
        return [SimpleNamespace(address=address, right_bound=None if self.owns_nothing(address) else 1) for address in there]

    async def reports(self) -> dict[str, Any]:
        owners = [node.address for node in await self.nodes() if node.right_bound is not None]
        each = {"records": OWNED // len(owners), "records_with_copies": OWNED // len(owners)}
        amiss = LACKING if self.amiss in ("mending", "coming") else {}
        return {address: report(address, arc(0, 1), copies=copies(owned=each, **amiss)) for address in owners}

    async def health(self) -> Any:
        return SimpleNamespace(records=OWNED)

    def owns_nothing(self, address: str) -> bool:
        return address == self.addresses[-1] and self.amiss == "coming"


async def test_the_last_node_is_slow_then_dead_then_comes_back_empty_and_reads_of_each_time_are_told_apart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, autojump_clock: MockClock
) -> None:
    village: Any = Village(tmp_path)

    @asynccontextmanager
    async def connect(profile: Path) -> AsyncIterator[Any]:
        assert profile == village.profile
        yield village

    monkeypatch.setattr("scenefold.client.connect", connect)
    found = await bench_weather.weather(village, village)
    phases = {row["phase"]: row for row in found["phases"]}
    assert list(phases) == [CALM, "slow disk", "dead node", "repair", "newcomer"]
    medians = {name: row["p50_ms"] for name, row in phases.items()}
    amiss = {CALM: "", "slow disk": "slow", "dead node": "dead", "repair": "mending", "newcomer": "coming"}
    assert medians == pytest.approx({name: 1000 * READ_S[what] for name, what in amiss.items()})
    assert phases["slow disk"]["of_calm"] == pytest.approx(5.0)
    seconds = {
        CALM: 2 * bench_weather.CALM_S,
        "slow disk": bench_weather.SLOW_S,
        "dead node": REMOVED_S,
        "repair": MENDED_S,
        "newcomer": CAME_S,
    }
    for name, row in phases.items():
        assert row["reads"] + row["failed"] == pytest.approx(seconds[name] * READS_PER_S, rel=0.3), name
        assert bool(row["failures"]) == (name == "dead node")
    assert set(village.written) == set(range(bench_weather.FIRST, bench_weather.FIRST + bench_weather.RECORDS))
    assert sum(village.written.values()) > bench_weather.RECORDS and not village.amiss


@pytest.mark.parametrize(
    "amiss",
    [
        LACKING,
        {"mis_placed": {"segments": 1, "records": 0}},
        {"forbidden": {"segments": 0, "records": 7, "nodes": []}},
        {"comparing": {"segments": 1, "records": 7}},
        {"owed": {"records": 7, "records_to_silent": 0, "nodes": []}},
        {"unsettled": {"records": 7, "pieces": 0, "read": True}},
        {"unrecovered": {"pieces": 1, "share": 0.1}},
        {"owned": {"records": 19, "records_with_copies": 19}},
    ],
    ids=lambda amiss: next(iter(amiss)),
)
async def test_a_cluster_is_whole_once_nothing_is_amiss_and_all_is_owned(amiss: dict[str, Any]) -> None:
    half = {"records": 20, "records_with_copies": 20}
    said: dict[str, Any] = {address: report(address, arc(0, 1), copies=copies(owned=half)) for address in ADDRESSES[:2]}
    watcher: Any = SimpleNamespace()

    async def reports() -> dict[str, Any]:
        return said

    watcher.reports = reports
    assert await bench_weather._is_whole(watcher, 40)
    said[ADDRESSES[1]] = report(ADDRESSES[1], arc(0, 1), copies=copies(**{"owned": half, **amiss}))
    assert not await bench_weather._is_whole(watcher, 40)
    for nothing in (report(ADDRESSES[1], arc(0, 1)), Unreachable("it is away")):
        said[ADDRESSES[1]] = nothing
        assert not await bench_weather._is_whole(watcher, 20)
