"""If this fails, an image depends on who made it, or the table that says whether it does says nothing."""

from __future__ import annotations

from dataclasses import replace

import pytest

from scenefold.render.job import RenderOptions
from scenefold.render.rehearsal import hashes
from scenefold.render.rehearsal.hashes import Contract, Mishap, Row
from scenefold.render.rehearsal.pool import Records
from scenefold.world import offline_world

OPTIONS = RenderOptions(width=64, height=48, samples=64, seed=3, sky=(0.2, 0.3, 0.5), depth=4)


async def rows_of(room: Records, counts: list[int], algorithms: list[str], mishaps: list[Mishap]) -> list[Row]:
    return [row async for row in Contract(offline_world(), room, OPTIONS).rows(counts, algorithms, mishaps)]


@pytest.mark.expect_log("nodes go on")
async def test_all_rows_have_one_hash_and_show_that_they_are_of_several_nodes(room: Records) -> None:
    rows = await rows_of(room, [2, 5], ["kd"], list(Mishap))
    assert len(rows) == 1 + 2 * 2 * 4 and len({row.sha256 for row in rows}) == 1
    assert [row.broken for row in rows] == [""] * len(rows)
    assert all(
        row.passed_per_path > hashes.PASSED_MIN and row.share is not None and row.share < 0.9 for row in rows if row.nodes - row.lost > 1
    )
    assert [row.lost for row in rows if row.mishap is Mishap.KILLED] == [1] * 4
    assert sum(row.moved for row in rows if row.moving) > 0 == sum(row.moved for row in rows if not row.moving)
    assert {row.document()["mishap"] for row in rows} == {"none", "5 % lost", "5 % doubled", "one killed"}


async def test_what_is_broken_is_said(room: Records, monkeypatch: pytest.MonkeyPatch) -> None:
    images = iter(range(100))
    monkeypatch.setattr(hashes, "hash_of", lambda *_: f"{next(images)}")
    monkeypatch.setattr(hashes, "_kill_at", lambda _pool, _packets: None)
    options = replace(OPTIONS, samples=4)
    contract = Contract(offline_world(), room, options)
    alone, fixed, killed, *_ = [row async for row in contract.rows([2], ["kd"], [Mishap.KILLED])]
    assert alone.broken == "" and fixed.broken == killed.broken == "another image"
    monkeypatch.setattr(hashes, "hash_of", lambda *_: "0")
    monkeypatch.setattr(hashes, "PASSED_MIN", 1e9)
    *_, other, fixed, killed = [row async for row in Contract(offline_world(), room, options).rows([2], ["kd"], [])][:4]
    assert other.broken == "another seed has the same hash" and "rays passed" in fixed.broken
    monkeypatch.setattr(hashes, "PASSED_MIN", 0.0)
    rows = [row async for row in Contract(offline_world(), room, options).rows([2], ["kd"], [Mishap.KILLED])]
    assert [row.broken for row in rows if row.mishap is Mishap.KILLED] == ["nobody was lost"] * 2
    monkeypatch.setattr(hashes, "SHARE_MAX", 0.1)
    monkeypatch.setattr(hashes, "SHARED_FROM", 2)
    rows = [row async for row in Contract(offline_world(), room, options).rows([2], ["kd"], [])]
    assert "of all triangles" in rows[-1].broken
