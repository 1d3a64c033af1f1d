"""If this fails, a render that nobody waits for is given up, or its image is gone before it is fetched, or told to another user (specs/19-jobs.md)."""

from __future__ import annotations

import gc
from typing import Any

import pytest
import trio

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.render.job import RenderOptions
from scenefold.render.pool import organiser, service
from scenefold.render.pool.request import options_of
from scenefold.render.pool.service import JOBS_OF_A_USER_MAX
from scenefold.render.pool.unattended import ALL_JOBS, Unattended
from scenefold.render.rehearsal.pool import USER, MemoryPool, Records, memory_pool, sha256_of
from scenefold.scene.tables import SceneTables
from scenefold.wire import CancelJob, JobAnswer, JobState, JobStateReply, unpack_value
from scenefold.world.real.world import offline_world

TINY = RenderOptions(width=16, height=12, samples=4, sky=(0.2, 0.3, 0.5))
LONG = RenderOptions(width=320, height=240, samples=4096, sky=(0.2, 0.3, 0.5))
KITCHEN = Unattended("kitchen", -1.5)


async def jobs(pool: MemoryPool, node: NodeId, user: str = USER) -> list[dict[str, Any]]:
    """What a node tells a user of its jobs."""
    reply = await pool.deliver(user, node, JobState(job=ALL_JOBS))
    assert isinstance(reply, JobStateReply)
    document = unpack_value(reply.document, what="jobs")
    assert isinstance(document, dict) and set(document) == {"jobs", "numeric_class"}
    return list(document["jobs"])


async def refused(pool: MemoryPool, job: int) -> bool:
    """Whether there is no place for it, yet."""
    answer = await pool.ask(pool.nodes[0], pool.request(job, TINY, pool.nodes, unattended=KITCHEN))
    assert isinstance(answer, JobAnswer)
    return bool(answer.reason)


async def test_whoever_began_it_finds_it_and_nobody_else(room: Records) -> None:
    async with memory_pool(offline_world(), room, 3) as pool:
        owner = await pool.start(7, TINY, unattended=KITCHEN)
        other = await pool.start(8, TINY, [owner])
        assert other == owner
        await pool.until(7, owner, "done")
        first, second = await jobs(pool, owner)
        assert (first["job"], first["unattended"], first["phase"]) == (7, ["kitchen", -1.5], "done")
        assert first["closed"] == first["passes"] > 0 and first["age"] >= second["age"] >= 0.0 and not first["failure"]
        assert (second["job"], second["unattended"]) == (8, None)
        assert options_of(first["options"]) == TINY
        assert await jobs(pool, owner, "user:another") == []
        assert [await jobs(pool, node) for node in pool.nodes if node != owner] == [[], []]
        image, state = await pool.finished(7, owner)
        assert image and state["unattended"] == ["kitchen", -1.5]
        assert [row["job"] for row in await jobs(pool, owner)] == [8]


async def test_the_image_is_that_of_a_client_that_waits(room: Records) -> None:
    async with memory_pool(offline_world(), room, 2) as pool:
        waited, _ = await pool.render(11, TINY)
        image, _ = await pool.finished(12, await pool.start(12, TINY, unattended=KITCHEN))
    assert sha256_of(image) == sha256_of(waited)


@pytest.mark.expect_log("given up")
async def test_it_goes_on_though_nobody_asks(room: Records, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(organiser, "FORSAKEN_S", 0.1)
    monkeypatch.setattr(service, "LOOK_S", 0.05)
    async with memory_pool(offline_world(), room, 1) as pool:
        owner = await pool.start(1, LONG, unattended=KITCHEN)
        await pool.start(2, LONG)
        with trio.fail_after(60):
            # One looks for both at once: whoever asks for one of them keeps it alive.
            while len(rows := await jobs(pool, owner)) > 1 or rows[0]["phase"] != "rendering":
                await pool.world.clock.sleep(0.02)
        assert [row["job"] for row in rows] == [1]
        for _ in range(2):
            # Twice is no more than once.
            await pool.ask(owner, CancelJob(job=1))
        assert await jobs(pool, owner) == []


async def test_its_image_makes_way_for_nobody(room: Records, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(organiser, "IDLE_S", -1.0)
    async with memory_pool(offline_world(), room, 1) as pool:
        for number in range(1, JOBS_OF_A_USER_MAX + 1):
            await pool.until(number, await pool.start(number, TINY, unattended=KITCHEN), "done")
        with pytest.raises(Refused, match="as many jobs"):
            await pool.start(90, TINY, unattended=KITCHEN)
        await pool.ask(pool.nodes[0], CancelJob(job=2))
        assert [row["job"] for row in await jobs(pool, pool.nodes[0])] == [1, 3, 4]
        with trio.fail_after(30):
            while await refused(pool, 90):
                await pool.world.clock.sleep(0.01)
        assert sorted(row["job"] for row in await jobs(pool, pool.nodes[0])) == [1, 3, 4, 90]


async def test_what_it_failed_of_is_kept(room: Records) -> None:
    async with memory_pool(offline_world(), room, 1) as pool:
        owner = await pool.start(5, RenderOptions(camera="nobody"), unattended=KITCHEN)
        await pool.until(5, owner, "failed")
        (row,) = await jobs(pool, owner)
        assert row["phase"] == "failed" and "nobody" in row["failure"]


async def test_a_client_that_waits_hears_that_its_user_ended_it(room: Records) -> None:
    """Else it would begin it anew."""
    async with memory_pool(offline_world(), room, 1) as pool:
        owner = await pool.start(3, LONG)
        await pool.ask(owner, CancelJob(job=3))
        with pytest.raises(Refused, match="its user has ended that render") as caught:
            await pool.until(3, owner, "done")
        assert caught.value.reason is RejectReason.OUTSIDE_BOUNDS
        with pytest.raises(Refused, match="no such job") as other:
            await pool.deliver("user:another", owner, JobState(job=3))
        assert other.value.reason is RejectReason.NOT_READY


@pytest.mark.parametrize("fails", [False, True])
async def test_nothing_of_the_scene_is_kept_for_a_day(room: Records, monkeypatch: pytest.MonkeyPatch, fails: bool) -> None:
    def image(*_: object) -> bytes:
        raise Refused(RejectReason.DAMAGED, "no image")

    if fails:
        monkeypatch.setattr(organiser, "_image", image)
    gc.collect()
    before = tables_alive()
    async with memory_pool(offline_world(), room, 2) as pool:
        owner = await pool.start(6, TINY, unattended=KITCHEN)
        await pool.until(6, owner, "failed" if fails else "done")
        with trio.fail_after(30):
            while gc.collect() >= 0 and tables_alive() > before:
                await pool.world.clock.sleep(0.1)


def tables_alive() -> int:
    return sum(isinstance(one, SceneTables) for one in gc.get_objects())


async def test_images_that_nobody_fetches_take_a_part_of_the_memory(room: Records, monkeypatch: pytest.MonkeyPatch) -> None:
    async with memory_pool(offline_world(), room, 1) as pool:
        monkeypatch.setattr(service, "PINNED_SHARE", pool.hosts[pool.nodes[0]].memory_bytes // (16 * 12 * 40 * 2))
        for number in (1, 2):
            await pool.until(number, await pool.start(number, TINY, unattended=KITCHEN), "done")
        with pytest.raises(Refused, match="images that nobody has fetched") as caught:
            await pool.start(3, TINY, unattended=KITCHEN)
        assert caught.value.reason is RejectReason.BUSY
        await pool.until(4, await pool.start(4, TINY), "done")
