"""If this fails, a render that was interrupted begins anew, or ends in another image than it would have."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from render.painted_room import write_room
from scenefold.base.errors import PeerFault, Refused
from scenefold.base.ids import NodeId
from scenefold.render.job import RenderOptions
from scenefold.render.levels import Adaptive
from scenefold.render.pool.request import Keep
from scenefold.render.rehearsal.pool import MemoryPool, Records, memory_pool, records_of, sha256_of
from scenefold.wire import CancelJob, FetchFilm, FilmPart, ImagePart, JobAnswer
from scenefold.world.real.world import offline_world

OPTIONS = RenderOptions(width=96, height=72, samples=128, seed=3, sky=(0.2, 0.3, 0.5), layers=("position", "samples", "variance"))
ADAPTIVE = replace(OPTIONS, samples=512, adaptive=Adaptive(0.05, 32))


async def fetched(pool: MemoryPool, job: int, owner: NodeId, passes: int) -> bytes:
    film = b""
    while True:
        part = await pool.ask(owner, FetchFilm(job=job, passes=passes, offset=len(film)))
        assert isinstance(part, ImagePart)
        film += part.payload
        if len(film) == part.total_bytes:
            return film


async def interrupted(records: Records, options: RenderOptions, nodes: int, least: int = 1) -> tuple[Keep, bytes]:
    """Render, and stop once a film of that many passes is kept."""
    async with memory_pool(offline_world(), records, nodes) as pool:
        owner = await pool.start(7, options, keep=Keep())
        while True:
            state = await pool.state(7, owner)
            assert state["phase"] in ("preparing", "rendering"), "it should not be over before a film of it is kept"
            if state["kept_passes"] >= least:
                film = await fetched(pool, 7, owner, state["kept_passes"])
                await pool.ask(owner, CancelJob(job=7))
                return Keep(state["kept_passes"], state["content"], state["numeric_class"]), film
            await pool.world.clock.sleep(0.002)


async def send(pool: MemoryPool, job: int, owner: NodeId, film: bytes, piece: int = 300_000) -> None:
    count = -(-len(film) // piece)
    for index in range(count):
        part = film[index * piece : (index + 1) * piece]
        answer = await pool.ask(owner, FilmPart(job=job, gathering=0, part_index=index, part_count=count, payload=part))
        assert isinstance(answer, JobAnswer) and not answer.reason


async def resumed(records: Records, options: RenderOptions, nodes: int, keep: Keep, film: bytes) -> tuple[bytes, dict[str, Any]]:
    async with memory_pool(offline_world(), records, nodes) as pool:
        owner = await pool.start(99, options, keep=keep)
        await send(pool, 99, owner, film)
        return await pool.finished(99, owner)


@pytest.mark.parametrize(("before", "after"), [(1, 1), (2, 3)])
async def test_an_image_has_the_bits_of_the_undisturbed_one(room: Records, before: int, after: int) -> None:
    async with memory_pool(offline_world(), room, 1) as pool:
        undisturbed, _ = await pool.render(1, OPTIONS)
    keep, film = await interrupted(room, OPTIONS, before)
    assert 0 < keep.passes < OPTIONS.plan.count
    image, state = await resumed(room, replace(OPTIONS, algorithm="voronoi"), after, keep, film)
    assert sha256_of(image) == sha256_of(undisturbed)
    assert (state["passes"], state["closed"], state["paths"]) == (OPTIONS.plan.count, OPTIONS.plan.count, OPTIONS.plan.paths)
    assert state["paths_before"] == OPTIONS.plan.first_path(keep.passes)
    again = sum(node["closed"] for node in state["nodes"])
    assert again == OPTIONS.plan.count - keep.passes, "what was closed is traced once"


async def test_a_render_with_levels_goes_on_within_one(room: Records) -> None:
    async with memory_pool(offline_world(), room, 1) as pool:
        undisturbed, _ = await pool.render(1, ADAPTIVE)
    for least in (1, ADAPTIVE.plan.passes_until(0), ADAPTIVE.plan.passes_until(0) + 1):
        keep, film = await interrupted(room, ADAPTIVE, 1, least)
        assert keep.passes >= least
        image, _ = await resumed(room, ADAPTIVE, 2, keep, film)
        assert sha256_of(image) == sha256_of(undisturbed), f"from pass {keep.passes}"


async def test_another_scene_or_renderer_is_refused_with_one_clear_error(room: Records) -> None:
    keep = Keep(4, bytes(32), "embree")
    async with memory_pool(offline_world(), room, 1) as pool:
        owner = await pool.start(11, OPTIONS, keep=keep)
        assert "the scene is not the one that the kept render is of" in (await pool.until(11, owner, "failed"))["failure"]
        with pytest.raises(Refused, match="kept render"):
            await send(pool, 11, owner, b"12")
        right, _ = await interrupted(room, OPTIONS, 1)
        owner = await pool.start(12, OPTIONS, keep=replace(right, numeric_class="of another renderer"))
        assert "of the numeric class of another renderer" in (await pool.until(12, owner, "failed"))["failure"]


async def test_a_corner_that_moved_makes_another_scene(room: Records, tmp_path: Path) -> None:
    # Within the box of its group: no table tells of it.
    moved = write_room(tmp_path, block="v 0.1 0.1 -0.35")
    keep, _ = await interrupted(room, OPTIONS, 1)
    async with memory_pool(offline_world(), records_of(moved), 2) as pool:
        owner = await pool.start(14, OPTIONS, keep=keep)
        state = await pool.until(14, owner, "failed")
        assert "was changed" in state["failure"]
        assert state["closed"] <= state["passes"], "a client takes no other state"


async def test_pieces_that_do_not_fit_are_refused(room: Records) -> None:
    keep, film = await interrupted(room, OPTIONS, 1)
    async with memory_pool(offline_world(), room, 1) as pool:
        owner = await pool.start(13, OPTIONS, keep=keep)
        for index, payload in ((1, b"12"), (0, b""), (0, film + b"1")):
            with pytest.raises(PeerFault):
                await pool.ask(owner, FilmPart(job=13, gathering=0, part_index=index, part_count=5, payload=payload))
        with pytest.raises(Refused, match="kept no longer"):
            await pool.ask(owner, FetchFilm(job=13, passes=3, offset=0))
        await pool.ask(owner, CancelJob(job=13))
