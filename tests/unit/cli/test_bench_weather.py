"""If this fails, the report of reads in bad weather counts what it should not, or a slow disk is not slow."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import trio
from trio.testing import MockClock

from scenectl import bench_weather, slow_node
from scenectl.bench_weather import CALM, READ_S_MAX, READS_PER_S, Reader, weather_text
from scenefold.base.errors import Unreachable


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
