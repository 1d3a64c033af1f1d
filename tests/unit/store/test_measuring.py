"""If this failed, `scenectl bench store` would have nothing to show."""

from __future__ import annotations

from pathlib import Path

from scenefold.store import measure_store
from unit.store.samples import world


async def test_rates_of_each_concurrency(tmp_path: Path) -> None:
    rates = await measure_store(world(), tmp_path, step_s=0.05, concurrencies=(1, 4), record_bytes=1000)
    assert [rate.concurrency for rate in rates.writes + rates.reads] == [1, 4, 1, 4]
    assert all(rate.operations > 0 for rate in rates.writes + rates.reads)
    assert all(0 < rate.commits <= rate.operations for rate in rates.writes)
