"""If this fails, nodes no longer make the image together that one node makes alone, or a pool hangs or leaks."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import trio
import trio.testing

from render.painted_room import write_room
from scenefold.base.errors import DamagedData, PeerFault, Refused, Unreachable
from scenefold.base.rays import RAY_BYTES
from scenefold.base.reasons import RejectReason
from scenefold.render.in_memory import RecordsInMemory, one_node_job
from scenefold.render.job import RenderOptions
from scenefold.render.pool.company import ASK_S_MAX
from scenefold.render.pool.organiser import Organiser
from scenefold.render.pool.request import organiser_of
from scenefold.render.pool.share import load_share, read_tables
from scenefold.render.rehearsal.pool import SCENE_KEY, Records, memory_pool, sha256_of
from scenefold.scene.log import EpochKeys
from scenefold.wire import (
    AcknowledgeRays,
    CancelJob,
    CollectPass,
    FilmPart,
    JobAnswer,
    JobEvent,
    JobState,
    MergeFilm,
    Packet,
    PassCounts,
    RayBatch,
    SendRays,
    pack_value,
)
from scenefold.world import Clock
from scenefold.world.real.world import offline_world

SMALL = RenderOptions(width=48, height=36, samples=8, seed=3, sky=(0.2, 0.3, 0.5))


async def _render(records: Records, nodes: int, options: RenderOptions, job: int = 11) -> tuple[str, dict[str, object]]:
    async with memory_pool(offline_world(), records, nodes) as pool:
        image, state = await pool.render(job, options)
    return sha256_of(image), state


async def test_any_number_of_nodes_and_either_algorithm_give_the_same_bits(room: Records) -> None:
    alone, _ = await _render(room, 1, SMALL)
    for algorithm in ("voronoi", "bounded-radial"):
        for nodes in (2, 5):
            options = RenderOptions(width=48, height=36, samples=8, seed=3, sky=(0.2, 0.3, 0.5), algorithm=algorithm)
            together, state = await _render(room, nodes, options, job=nodes * 100)
            assert together == alone, f"{algorithm} on {nodes} nodes"
            passed = sum(node["rays_sent"] for node in state["nodes"])  # type: ignore[attr-defined]
            assert passed / (48 * 36 * 8) > 0.3


async def test_another_seed_gives_another_image(room: Records) -> None:
    first, _ = await _render(room, 1, SMALL)
    second, _ = await _render(room, 1, RenderOptions(width=48, height=36, samples=8, seed=4, sky=(0.2, 0.3, 0.5)))
    assert first != second


async def test_a_job_of_several_passes_closes_them_all(room: Records) -> None:
    options = RenderOptions(width=160, height=120, samples=16, sky=(1.0, 1.0, 1.0))
    alone, state = await _render(room, 1, options)
    assert state["passes"] == 5 and state["closed"] == 5
    together, state = await _render(room, 3, options, job=5)
    assert together == alone
    assert state["closed"] == 5


async def test_rays_are_counted_alike_on_both_sides(room: Records) -> None:
    _, state = await _render(room, 4, SMALL)
    nodes = state["nodes"]
    assert sum(node["rays_sent"] for node in nodes) == sum(node["rays_received"] for node in nodes)  # type: ignore[attr-defined]


async def test_a_node_that_is_away_before_anything_is_traced_fails_the_job_with_its_address(room: Records) -> None:
    async with memory_pool(offline_world(), room, 3) as pool:
        lost = next(node for node in pool.nodes if node != organiser_of(21, pool.nodes))
        pool.hosts[lost].away = True
        owner = await pool.start(21, SMALL)
        state = await pool.until(21, owner, "failed")
        assert f"127.0.0.{lost & 255}" in state["failure"]


async def test_a_cancelled_job_leaves_nothing_behind(room: Records) -> None:
    long = RenderOptions(width=320, height=240, samples=512)
    async with memory_pool(offline_world(), room, 2) as pool:
        owner = await pool.start(31, long)
        await pool.until(31, owner, "rendering")
        await pool.ask(owner, CancelJob(job=31))
        with trio.fail_after(60):
            while True:
                try:
                    await pool.state(31, owner)
                except Refused:
                    break
                await trio.lowlevel.checkpoint()
        # The nodes are free again: another job runs.
        image, _ = await pool.render(32, SMALL)
        assert image


async def test_two_jobs_at_once_do_not_disturb_each_other(room: Records) -> None:
    alone, _ = await _render(room, 1, SMALL)
    async with memory_pool(offline_world(), room, 2) as pool:
        images: dict[int, bytes] = {}

        async def one(job: int) -> None:
            images[job], _ = await pool.render(job, SMALL)

        async with trio.open_nursery() as nursery:
            nursery.start_soon(one, 41)
            nursery.start_soon(one, 42)
    assert sha256_of(images[41]) == sha256_of(images[42]) == alone


async def test_an_unknown_camera_is_one_clear_error(room: Records) -> None:
    async with memory_pool(offline_world(), room, 2) as pool:
        owner = await pool.start(51, RenderOptions(camera="nobody"))
        state = await pool.until(51, owner, "failed")
        assert "no camera 'nobody'" in state["failure"]


async def test_an_empty_scene_is_one_clear_error() -> None:
    async with memory_pool(offline_world(), {}, 2) as pool:
        owner = await pool.start(61, SMALL)
        state = await pool.until(61, owner, "failed")
        assert "empty" in state["failure"]


async def test_a_scene_that_was_imported_anew_meanwhile_is_not_mixed_with_the_one_before(tmp_path: Path) -> None:
    workers = offline_world().workers
    before = await one_node_job(write_room(tmp_path), SMALL, "any", workers)
    # Within the box of its group: no table tells of it.
    after = RecordsInMemory(write_room(tmp_path, block="v 0.1 0.1 -0.35"))
    assert (await read_tables(after, workers)).document.content == before.loaded.tables.document.content
    with pytest.raises(DamagedData, match="changed since the job was made"):
        await load_share(after, workers, before.job, 0)


LONG = RenderOptions(width=320, height=240, samples=255)
"""Its last pass has fewer paths than a pass may have."""


def _frame(
    batches: tuple[RayBatch, ...] = (), rays: bytes = b"", *, sequence: int = 1, acknowledged: int = 0, closed: tuple[int, ...] = ()
) -> SendRays:
    return SendRays(71, 0, 0, sequence, acknowledged, b"", (), (), closed, batches, rays)


ILL_FORMED = {
    "less than a ray": _frame((RayBatch(0, 1, 1),), bytes(RAY_BYTES - 1)),
    "fewer rays than its batches have": _frame((RayBatch(0, 1, 2),), bytes(RAY_BYTES)),
    "rays of no batch": _frame((), bytes(RAY_BYTES)),
    "no such pass": _frame((RayBatch(0, 1, 1), RayBatch(299, 1, 1)), bytes(2 * RAY_BYTES)),
    "no such path": _frame((RayBatch(298, 1, 1),), b"\xff" * RAY_BYTES),
    "no such number": _frame(sequence=1 << 40),
    "no such packet": _frame(acknowledged=1 << 40),
    "no such pass to close": _frame(closed=(299,)),
}


@pytest.mark.parametrize("packet", ILL_FORMED.values(), ids=ILL_FORMED)
async def test_what_is_ill_formed_is_refused(packet: SendRays, room: Records) -> None:
    async with memory_pool(offline_world(), room, 2) as pool:
        owner = await pool.start(71, LONG)
        await pool.until(71, owner, "rendering")
        with pytest.raises(PeerFault):
            await pool.deliver(f"node:{pool.nodes[1]}", pool.nodes[0], packet)
        assert (await pool.state(71, owner))["phase"] == "rendering"


async def test_users_may_not_speak_as_nodes(room: Records) -> None:
    async with memory_pool(offline_world(), room, 1) as pool:
        with pytest.raises(Refused):
            await pool.ask(pool.nodes[0], JobEvent(job=1, document=pack_value({"go": True})))


async def test_who_was_not_chosen_is_told_nothing_and_the_image_is_the_same(room: Records) -> None:
    alone, _ = await _render(room, 1, SMALL)
    async with memory_pool(offline_world(), room, 4) as pool:
        chosen = [pool.nodes[0], pool.nodes[2]]
        image, state = await pool.render(81, SMALL, chosen)
        assert sha256_of(image) == alone
        assert [node["address"] for node in state["nodes"]] == ["127.0.0.2", "127.0.0.4"]
        for node in pool.nodes:
            if node in chosen:
                assert set(pool.hosts[node].keys) == {EpochKeys.only(SCENE_KEY)}
            else:
                assert not pool.delivered[node] and not pool.hosts[node].keys
        # Not to those that were chosen either, but sealed.
        assert not any(SCENE_KEY in packet for packets in pool.delivered.values() for packet in packets)


async def test_whose_trust_ended_during_a_render_is_told_nothing_of_the_next_one(room: Records) -> None:
    # Numbers of nine bytes on the wire, so that they are found in what was said.
    first, second = (2**63 + number for number in (82, 83))
    long = RenderOptions(width=320, height=240, samples=512)
    async with memory_pool(offline_world(), room, 3) as pool:
        owner = await pool.start(first, long)
        await pool.until(first, owner, "rendering")
        image, _ = await pool.render(second, SMALL, pool.nodes[:2])
        assert image
        told = {
            job: [any(job.to_bytes(8, "big") in packet for packet in pool.delivered[node]) for node in pool.nodes]
            for job in (first, second)
        }
        # The first one goes on with the keys that its nodes have.
        assert told == {first: [True, True, True], second: [True, True, False]}
        assert (await pool.state(first, owner))["phase"] == "rendering"
        await pool.ask(owner, CancelJob(job=first))


async def test_who_was_not_chosen_does_not_organise(room: Records) -> None:
    async with memory_pool(offline_world(), room, 3) as pool:
        answer = await pool.ask(pool.nodes[2], pool.request(84, SMALL, pool.nodes[:2]))
        assert isinstance(answer, JobAnswer)
        assert answer.reason == RejectReason.NOT_AUTHORISED and "not sealed to this node" in answer.text
        with pytest.raises(Refused):
            await pool.state(84, pool.nodes[2])


async def test_a_chosen_node_that_has_left_is_passed_over(room: Records) -> None:
    alone, _ = await _render(room, 1, SMALL)
    async with memory_pool(offline_world(), room, 3) as pool:
        request = pool.request(85, SMALL, pool.nodes)
        left = pool.nodes.pop()
        assert (await pool.ask(pool.nodes[0], request)).reason == 0
        image, _ = await pool.finished(85, pool.nodes[0])
        assert sha256_of(image) == alone
        assert not pool.delivered[left]


@pytest.mark.parametrize(
    "packet",
    [
        JobState(job=86),
        CancelJob(job=86),
        CollectPass(job=86, pass_index=0, attempt=0),
        MergeFilm(job=86, gathering=1),
        FilmPart(job=86, gathering=1, part_index=0, part_count=1, payload=b""),
        JobEvent(job=86, document=pack_value({"go": True})),
        AcknowledgeRays(job=86, attempt=0, all_until=0, selective=b""),
        SendRays(86, 0, 0, 1, 0, b"", (), (PassCounts(0, 1, 1, 0, 0),), (0,), (RayBatch(0, 1, 1),), bytes(RAY_BYTES)),
    ],
    ids=lambda packet: type(packet).__name__,
)
async def test_a_node_outside_of_the_job_learns_and_changes_nothing_of_it(packet: Packet, room: Records) -> None:
    async with memory_pool(offline_world(), room, 3) as pool:
        chosen, outsider = pool.nodes[:2], pool.nodes[2]
        owner = await pool.start(86, RenderOptions(width=320, height=240, samples=256), chosen)
        await pool.until(86, owner, "rendering")
        for node in chosen:
            with pytest.raises(Refused) as caught:
                await pool.deliver(f"node:{outsider}", node, packet)
            assert caught.value.reason is RejectReason.NOT_AUTHORISED
        assert (await pool.state(86, owner))["phase"] == "rendering"


async def test_who_is_asked_in_vain_is_away(room: Records) -> None:
    async with memory_pool(offline_world(), room, 2) as pool:
        asks, asked = pool.nodes

        async def waits(_packet: Packet, _peer: str) -> Packet | None:
            await trio.sleep_forever()

        pool.hosts[asked].handlers[JobState] = (waits, False)
        with pytest.raises(Unreachable, match=r"within 0\.01 s"):
            await pool.hosts[asks].ask(asked, JobState(job=11), 0.01)


async def test_a_node_that_ends_waits_for_nothing(room: Records, monkeypatch: pytest.MonkeyPatch) -> None:
    """A job that was cancelled lets its nodes go; this one's own part may have ended by then."""
    free, begun = Organiser._free, trio.Event()

    async def free_last(self: Organiser) -> None:
        begun.set()
        await trio.testing.wait_all_tasks_blocked(cushion=0.5)  # what it traces in a thread has ended by then
        await free(self)

    monkeypatch.setattr(Organiser, "_free", free_last)
    with trio.fail_after(ASK_S_MAX / 2):
        async with memory_pool(offline_world(), room, 1) as pool:
            owner = await pool.start(11, RenderOptions(width=320, height=240, samples=4096, sky=(0.2, 0.3, 0.5)))
            await pool.until(11, owner, "rendering")
            await pool.ask(owner, CancelJob(job=11))
            await begun.wait()


class _Jumping:
    """A clock that goes on while its machine sleeps."""

    def __init__(self, clock: Clock) -> None:
        self._clock, self.slept_s = clock, 0.0

    def now(self) -> float:
        return self._clock.now() + self.slept_s

    def __getattr__(self, name: str) -> Any:
        return getattr(self._clock, name)


@pytest.mark.parametrize("algorithm", ["voronoi", "whole"])
async def test_nodes_that_have_slept_together_have_not_waited_for_each_other(room: Records, algorithm: str) -> None:
    """A laptop is shut for an hour: nothing could be acknowledged meanwhile, and nobody is lost."""
    world = offline_world()
    clock = _Jumping(world.clock)
    async with memory_pool(replace(world, clock=clock), room, 3) as pool:
        options = RenderOptions(width=96, height=72, samples=96, sky=(1.0, 1.0, 1.0), algorithm=algorithm)
        owner = await pool.start(12, options)
        for closed in (1, 3, 5):
            while (await pool.state(12, owner))["closed"] < closed:
                await world.clock.sleep(0.005)
            clock.slept_s += 3_600.0
        image, state = await pool.finished(12, owner)
    assert (state["lost"], state["attempts"]) == ([], 1)
    async with memory_pool(offline_world(), room, 1) as pool:
        assert sha256_of(image) == sha256_of((await pool.render(12, replace(options, algorithm="voronoi")))[0])
