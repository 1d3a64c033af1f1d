"""If this fails, a render, or several together, take more memory than their nodes may use, or leave some promised that nobody uses."""

from __future__ import annotations

from dataclasses import replace

import pytest
import trio

from scenefold.base.reasons import RejectReason
from scenefold.render.job import RenderOptions
from scenefold.render.pool import organiser
from scenefold.render.rehearsal.pool import MemoryHost, MemoryPool, Records, memory_pool
from scenefold.wire import CancelJob
from scenefold.world.real.world import offline_world

OPTIONS = RenderOptions(width=48, height=36, samples=8, seed=3, sky=(0.2, 0.3, 0.5))
LONG = replace(OPTIONS, samples=65_536)
TRIANGLE = "scenefold.render.pool.share.TRIANGLE_BYTES"


async def until_promised(pool: MemoryPool, count: int) -> None:
    with trio.fail_after(30.0):
        while sum(host.service.promises.held for host in pool.hosts.values()) != count:
            await pool.world.clock.sleep(0.01)


@pytest.mark.parametrize("algorithm", ["voronoi", "whole"])
async def test_a_pool_whose_memory_is_too_small_says_how_much_it_takes(
    room: Records, monkeypatch: pytest.MonkeyPatch, algorithm: str
) -> None:
    monkeypatch.setattr(TRIANGLE, MemoryHost.memory_bytes)
    async with memory_pool(offline_world(), room, 2) as pool:
        owner = await pool.start(1, replace(OPTIONS, algorithm=algorithm))
        state = await pool.until(1, owner, "done", "failed")
        assert state["phase"] == "failed" and state["failure_reason"] == RejectReason.OUTSIDE_BOUNDS
        words = ("a cell with", "render it with more nodes") if algorithm == "voronoi" else ("the whole scene", "another --algorithm")
        assert all(part in state["failure"] for part in (*words, "may use 1024 MiB", "more memory")), state["failure"]
        await until_promised(pool, 0)


async def test_what_another_render_has_is_waited_for(room: Records, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each fits alone."""
    async with memory_pool(offline_world(), room, 2) as pool:
        first = await pool.start(1, LONG)
        await pool.until(1, first, "rendering")
        held = max(host.service.promises.held for host in pool.hosts.values())
        assert held > 0
        for host in pool.hosts.values():
            host.service.promises.most = held * 3 // 2
        second = await pool.start(2, OPTIONS)
        state = await pool.until(2, second, "done", "failed")
        assert state["failure_reason"] == RejectReason.BUSY and "other renders have" in state["failure"]
        await pool.ask(first, CancelJob(job=1))
        await until_promised(pool, 0)
        await pool.until(3, await pool.start(3, OPTIONS), "done")


async def test_cells_that_move_give_back_what_they_left(room: Records) -> None:
    async with memory_pool(offline_world(), room, 3) as pool:
        owner = await pool.start(1, replace(OPTIONS, samples=1_024, algorithm="bounded-radial"))
        state = await pool.until(1, owner, "done")
        assert state["moved"] > 0, "else nothing was left"
        await until_promised(pool, state["image_bytes"])
        await pool.ask(owner, CancelJob(job=1))
        await until_promised(pool, 0)


async def test_an_image_that_nobody_fetches_makes_room(room: Records, monkeypatch: pytest.MonkeyPatch) -> None:
    async with memory_pool(offline_world(), room, 1) as pool:
        (host,) = pool.hosts.values()
        owner = await pool.start(1, OPTIONS)
        image = (await pool.until(1, owner, "done"))["image_bytes"]
        await until_promised(pool, image)
        await pool.start(2, LONG)
        await pool.until(2, owner, "rendering")
        needs = host.service.promises.held - image
        await pool.ask(owner, CancelJob(job=2))
        await until_promised(pool, image)
        host.service.promises.most = needs + image - 1
        assert (await pool.until(3, await pool.start(3, OPTIONS), "done", "failed"))["failure_reason"] == RejectReason.BUSY
        monkeypatch.setattr(organiser, "IDLE_S", -1.0)
        await pool.until(4, await pool.start(4, OPTIONS), "done")
