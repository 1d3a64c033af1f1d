"""If this fails, rays visit cells in which there is nothing, or go past cells in which there is something."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
import trio

from scenefold.render.job import RenderOptions
from scenefold.render.pool import company, part
from scenefold.render.rehearsal.pool import MemoryPool, Records, memory_pool, sha256_of
from scenefold.world.real.world import offline_world

OPTIONS = RenderOptions(width=96, height=72, samples=8, seed=5, sky=(0.2, 0.3, 0.5), algorithm="kd", moving=False)
JOB, NODES = 12, 7


@pytest.fixture(scope="module")
def alone(room: Records) -> str:
    async def render() -> str:
        async with memory_pool(offline_world(), room, 1) as pool:
            return sha256_of((await pool.render(JOB, OPTIONS))[0])

    return trio.run(render)


async def _passed(pool: MemoryPool, options: RenderOptions) -> tuple[str, int]:
    image, state = await pool.render(JOB, options)
    return sha256_of(image), sum(node["rays_sent"] for node in state["nodes"])


@pytest.mark.parametrize("algorithm", ["voronoi", "bounded-radial", "planar", "power", "kd"])
async def test_rays_go_past_empty_cells_and_the_image_is_the_same(
    room: Records, alone: str, algorithm: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    options = replace(OPTIONS, algorithm=algorithm)
    async with memory_pool(offline_world(), room, NODES) as pool:
        image, passed = await _passed(pool, options)
    with monkeypatch.context() as patch:
        patch.setattr(company, "joined", lambda _marks: b"")
        async with memory_pool(offline_world(), room, NODES) as pool:
            without, passed_without = await _passed(pool, options)
    assert image == without == alone
    assert passed < 0.8 * passed_without


async def test_where_one_node_does_not_tell_nobody_leaps(room: Records, alone: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """It may hold anything anywhere."""
    plain, told = part.packed, 0

    def all_but_the_second(grids: Any) -> bytes:
        nonlocal told
        told += 1
        return b"" if told == 2 else plain(grids)

    monkeypatch.setattr(part, "packed", all_but_the_second)
    async with memory_pool(offline_world(), room, NODES) as pool:
        image, passed = await _passed(pool, OPTIONS)
    monkeypatch.undo()
    async with memory_pool(offline_world(), room, NODES) as pool:
        _, passed_with = await _passed(pool, OPTIONS)
    assert told == NODES
    assert image == alone
    assert passed > 1.2 * passed_with
