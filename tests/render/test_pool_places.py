"""If this fails, jobs that came to nothing keep others from rendering, hold the scene's keys, or end the node that they were sent to."""

from __future__ import annotations

import gc
from dataclasses import replace

import numpy as np
import pytest
import trio
import trio.testing

from scenefold.base.errors import PeerFault, Refused
from scenefold.base.ids import NodeId, SceneId
from scenefold.base.reasons import RejectReason
from scenefold.partition import make_partition
from scenefold.render.contract import load_renderer
from scenefold.render.job import Job, RenderOptions
from scenefold.render.passes import PassPlan
from scenefold.render.pool import keeping, organiser, share
from scenefold.render.pool.own_passes import pass_owner
from scenefold.render.pool.request import RenderRequest
from scenefold.render.pool.service import JOBS_MAX, JOBS_OF_A_NODE_MAX, JOBS_OF_A_USER_MAX
from scenefold.render.rehearsal.pool import CLUSTER, GENESIS, SCENE_KEY, MemoryPool, memory_pool, records_of
from scenefold.render.sealed_keys import About, seal_keys
from scenefold.scene.log import EpochKeys
from scenefold.scene.sample import sample_scene_path
from scenefold.wire import CancelJob, CollectPass, JobAnswer, JobEvent, JobState, SendRays, StartJob, decode_packet
from scenefold.world.real.world import offline_world

TINY = RenderOptions(width=16, height=16, samples=1)
LONG = RenderOptions(width=320, height=240, samples=512)


def made(pool: MemoryPool, number: int, nodes: list[NodeId]) -> Job:
    """A job as an organiser would make it, of a scene that has other content."""
    one = np.ones(3)
    partition = make_partition("bounded-radial", len(nodes), np.stack([-one, one]), 0 * one, -one, one, np.zeros((1, 3)), np.ones(1))
    recipients = {node: pool.hosts[node].sealing.public for node in nodes}
    keys = seal_keys(EpochKeys.only(SCENE_KEY), recipients, About(CLUSTER, GENESIS, number), pool.world.entropy.token)
    return Job(
        id=number,
        scene=SceneId(1),
        genesis=GENESIS,
        keys=keys,
        content=bytes(32),
        numeric_class=load_renderer("embree").numeric_class(),
        width=16,
        height=16,
        samples=1,
        seed=1,
        frame=0,
        depth=2,
        sky=(0.0, 0.0, 0.0),
        camera=(0.0,) * 16,
        nodes=tuple(nodes),
        partition=partition,
    )


async def offered(pool: MemoryPool, job: Job, by: NodeId, to: NodeId) -> JobAnswer:
    answer = await pool.deliver(f"node:{by}", to, StartJob(job=job.id, document=job.to_bytes()))
    assert isinstance(answer, JobAnswer)
    return answer


def keys_alive(pool: MemoryPool) -> int:
    for host in pool.hosts.values():
        host.keys.clear()
    gc.collect()
    # By its type: a proxy of what is gone cannot be asked what it is an instance of.
    return sum(issubclass(type(one), EpochKeys) and SCENE_KEY in one.values() for one in gc.get_objects())


async def test_parts_that_failed_before_they_were_ready_take_no_places() -> None:
    async with memory_pool(offline_world(), {}, 2) as pool:
        good, liar = pool.nodes
        for number in range(1, 3 * JOBS_MAX):
            answer = await offered(pool, made(pool, number, [good, liar]), liar, good)
            assert answer.reason == RejectReason.OUTSIDE_BOUNDS and "empty" in answer.text
        # It fails of the scene, as it would have alone.
        assert (await offered(pool, made(pool, 99, [good, liar]), good, good)).reason == RejectReason.OUTSIDE_BOUNDS


async def test_jobs_that_failed_take_no_places_at_their_organiser_and_say_why() -> None:
    async with memory_pool(offline_world(), {}, 1) as pool:
        for number in range(1, 3 * JOBS_OF_A_USER_MAX):
            owner = await pool.start(number, TINY)
            assert "empty" in (await pool.until(number, owner, "failed"))["failure"]
        with pytest.raises(Refused, match="organises no such job"):
            await pool.state(1, pool.nodes[0])


async def test_jobs_that_failed_leave_few_tasks_and_no_requests() -> None:
    async with memory_pool(offline_world(), {}, 1) as pool:
        (node,) = pool.nodes
        few = trio.lowlevel.current_statistics().tasks_living + 3 * JOBS_OF_A_USER_MAX
        requests = requests_alive()
        for number in range(1, 6 * JOBS_OF_A_USER_MAX):
            await pool.start(number, TINY)
            await pool.until(number, node, "failed")
        await trio.testing.wait_all_tasks_blocked()
        assert trio.lowlevel.current_statistics().tasks_living < few
        assert requests_alive() <= requests


def requests_alive() -> int:
    gc.collect()
    return sum(type(one) is RenderRequest for one in gc.get_objects())


async def test_no_key_outlives_what_it_was_for() -> None:
    async with memory_pool(offline_world(), records_of(sample_scene_path()), 2) as pool:
        owner = await pool.start(1, RenderOptions(camera="nobody"))
        await pool.until(1, owner, "failed")
        await offered(pool, made(pool, 2, pool.nodes), *pool.nodes)
        owner = await pool.start(3, LONG)
        await pool.until(3, owner, "rendering")
        assert keys_alive(pool) == 0
        await pool.ask(owner, CancelJob(job=3))


async def test_images_of_clients_that_died_make_way(monkeypatch: pytest.MonkeyPatch) -> None:
    async with memory_pool(offline_world(), records_of(sample_scene_path()), 1) as pool:
        for number in range(1, JOBS_OF_A_USER_MAX + 1):
            await pool.until(number, await pool.start(number, TINY), "done")
        with pytest.raises(Refused):
            await pool.start(90, TINY)
        monkeypatch.setattr(organiser, "IDLE_S", -1.0)
        await pool.start(91, TINY)
        with pytest.raises(Refused, match="organises no such job"):
            await pool.state(1, pool.nodes[0])
        assert (await pool.state(2, pool.nodes[0]))["image_bytes"], "its place is not needed yet"


async def is_organised(pool: MemoryPool, number: int) -> bool:
    askers = ("user:test", "user:other", f"user:{number}")
    for asker in askers:
        try:
            await pool.deliver(asker, pool.nodes[0], JobState(job=number))
        except Refused:
            continue
        return True
    return False


async def test_a_user_who_fills_its_places_leaves_some_to_others() -> None:
    async with memory_pool(offline_world(), records_of(sample_scene_path()), 1) as pool:
        (node,) = pool.nodes
        for number in range(1, JOBS_OF_A_USER_MAX + 1):
            await pool.start(number, LONG)
        with pytest.raises(Refused) as caught:
            await pool.start(90, TINY)
        assert caught.value.reason is RejectReason.BUSY
        other = await pool.deliver("user:other", node, pool.request(91, TINY, [node]))
        assert isinstance(other, JobAnswer) and not other.reason
        for number in range(92, 99):
            await pool.deliver(f"user:{number}", node, pool.request(number, LONG, [node]))
        live = [number for number in range(1, 99) if await is_organised(pool, number)]
        assert len(live) == JOBS_OF_A_NODE_MAX, "more would find no place at the others"
        # Nor is anybody told of what others have rendered.
        with pytest.raises(Refused, match="organises no such job"):
            await pool.deliver("user:other", node, JobState(job=1))


async def test_a_job_with_a_node_that_has_no_box_is_refused() -> None:
    async with memory_pool(offline_world(), {}, 3) as pool:
        good, liar, stranger = pool.nodes
        job = replace(made(pool, 1, [good, liar, stranger]), keys=made(pool, 1, [good, liar]).keys)
        answer = await offered(pool, job, liar, good)
        assert answer.reason == RejectReason.ILL_FORMED and not pool.hosts[good].keys


async def test_sums_of_a_pass_that_the_job_does_not_have_are_refused() -> None:
    async with memory_pool(offline_world(), records_of(sample_scene_path()), 2) as pool:
        owner = await pool.start(1, LONG)
        state = await pool.until(1, owner, "rendering")
        other = next(node for node in pool.nodes if node != owner)
        for number in (state["passes"], 2**31):
            with pytest.raises(PeerFault, match="no such pass"):
                await pool.deliver(f"node:{owner}", other, CollectPass(job=1, pass_index=number, attempt=0))
        await pool.ask(owner, CancelJob(job=1))


@pytest.mark.expect_log("an internal error, ZeroDivisionError")
async def test_a_bug_over_a_job_fails_the_job_and_not_the_node(monkeypatch: pytest.MonkeyPatch) -> None:
    async with memory_pool(offline_world(), records_of(sample_scene_path()), 2) as pool:
        with monkeypatch.context() as broken:
            broken.setattr(share, "job_numbers", lambda *_: 1 // 0)
            owner = await pool.start(1, TINY)
            assert "its log says more" in (await pool.until(1, owner, "failed"))["failure"]
        image, _ = await pool.render(2, TINY)
        assert image


@pytest.mark.expect_log("an internal error, ZeroDivisionError")
async def test_any_number_of_bugs_over_jobs_are_one_line(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    async with memory_pool(offline_world(), records_of(sample_scene_path()), 1) as pool:
        monkeypatch.setattr(share, "job_numbers", lambda *_: 1 // 0)
        for number in range(1, 10):
            await pool.until(number, await pool.start(number, TINY), "failed")
    assert len([line for line in caplog.records if line.name == "scenefold.bugs"]) == 1


async def test_another_job_of_an_id_that_is_taken_is_refused() -> None:
    async with memory_pool(offline_world(), records_of(sample_scene_path()), 2) as pool:
        owner = await pool.start(1, LONG)
        await pool.until(1, owner, "rendering")
        other = next(node for node in pool.nodes if node != owner)
        (document,) = [packet.document for packet in map(decode_packet, pool.delivered[other]) if isinstance(packet, StartJob)]
        job = Job.from_bytes(document)
        assert not (await offered(pool, job, owner, other)).reason, "that it is offered twice is no matter"
        answer = await offered(pool, replace(job, seed=job.seed + 1), owner, other)
        assert answer.reason == RejectReason.ILL_FORMED and "another job of that id" in answer.text
        await pool.ask(owner, CancelJob(job=1))


async def test_an_organiser_speaks_to_all_before_it_says_go(monkeypatch: pytest.MonkeyPatch) -> None:
    """Else those that are ready first give their places back while the slowest prepares."""
    monkeypatch.setattr(keeping, "WORD_S", 0.01)
    async with memory_pool(offline_world(), records_of(sample_scene_path()), 2) as pool:
        await pool.render(1, TINY)
        for node in pool.nodes:
            told = [type(decode_packet(packet)) for packet in pool.delivered[node]]
            assert JobState in told[: told.index(JobEvent)]


def _closed(number: int) -> SendRays:
    return SendRays(1, 0, 0, 1, 0, b"", (), (), (number,), (), b"")


async def test_that_a_pass_is_closed_says_its_owner_and_nobody_else() -> None:
    """Whoever forgets a pass too early has lost what its rays brought, and the image is another."""
    async with memory_pool(offline_world(), records_of(sample_scene_path()), 3) as pool:
        owner = await pool.start(1, LONG)
        plan = PassPlan(1, LONG.width * LONG.height * LONG.samples)
        assert (await pool.until(1, owner, "rendering"))["passes"] == plan.count
        for number in range(plan.count):
            closes = pool.nodes[pass_owner(plan, number, len(pool.nodes))]
            liar, other = (node for node in pool.nodes if node != closes)
            with pytest.raises(Refused, match="closed by another node") as caught:
                await pool.deliver(f"node:{liar}", other, _closed(number))
            assert caught.value.reason is RejectReason.NOT_AUTHORISED
        with pytest.raises(PeerFault, match="no such pass"):
            await pool.deliver(f"node:{liar}", other, _closed(plan.count))
        await pool.ask(owner, CancelJob(job=1))
