"""If this fails, who waits for an image does not see what it looks like so far, or looking changes it, or holds it up."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import trio

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.render.arrays import F32
from scenefold.render.job import RenderOptions
from scenefold.render.levels import Adaptive
from scenefold.render.pool import organiser, previewing
from scenefold.render.pool.attempts import Attempts
from scenefold.render.pool.request import Keep
from scenefold.render.preview import Sums, picture_of, preview_bytes, unpack_preview
from scenefold.render.rehearsal.pool import MemoryPool, Records, memory_pool, sha256_of
from scenefold.wire import CancelJob, FetchPreview, ImagePart, Packet
from scenefold.world.real.world import offline_world

OPTIONS = RenderOptions(width=96, height=72, samples=128, seed=3, sky=(0.2, 0.3, 0.5), depth=4, algorithm="voronoi")
SIZE = (OPTIONS.width, OPTIONS.height)
JOB = 11


@pytest.fixture(autouse=True)
def is_quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """These jobs are short."""
    monkeypatch.setattr(organiser, "POLL_S", 0.01)
    monkeypatch.setattr(previewing, "PAUSE_S", 0.0)


class Gate:
    """Films are gathered once it is open: until then all passes are closed, each in its owner's film."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.opened, self.reached, gather = trio.Event(), trio.Event(), Attempts.gather

        async def late(attempts: Attempts, passes: Collection[int]) -> None:
            self.reached.set()
            await self.opened.wait()
            await gather(attempts, passes)

        patch.setattr(Attempts, "gather", late)


@pytest.fixture
def gate(monkeypatch: pytest.MonkeyPatch) -> Gate:
    return Gate(monkeypatch)


async def preview_from(pool: MemoryPool, owner: NodeId, number: int, part_bytes: int = 0) -> Sums:
    payload = b""
    while len(payload) < preview_bytes(*SIZE):
        part = await pool.ask(owner, FetchPreview(job=JOB, number=number, offset=len(payload)))
        assert isinstance(part, ImagePart) and part.offset == len(payload) and part.total_bytes == preview_bytes(*SIZE)
        assert not part_bytes or len(part.payload) <= part_bytes
        payload += part.payload
    return unpack_preview(payload, *SIZE)


async def refusal(pool: MemoryPool, owner: NodeId, number: int, offset: int = 0) -> Refused:
    with pytest.raises(Refused) as caught:
        await pool.ask(owner, FetchPreview(job=JOB, number=number, offset=offset))
    return caught.value


async def next_preview(pool: MemoryPool, owner: NodeId, number: int) -> Sums | None:
    """None, a moment later, if there is none yet."""
    try:
        return await preview_from(pool, owner, number)
    except Refused as refused:
        if refused.reason is not RejectReason.NOT_READY:
            raise
    await pool.world.clock.sleep(0.005)
    return None


def beauty_of(image: bytes) -> F32:
    beauty: F32 = np.frombuffer(image[: 12 * OPTIONS.window.pixels], "<f4").reshape(OPTIONS.height, OPTIONS.width, 3)
    return beauty


@pytest.mark.parametrize("nodes", [1, 2, 5])
async def test_a_preview_has_all_that_is_closed_and_nothing_twice(
    room: Records, gate: Gate, nodes: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(previewing, "PART_BYTES", 10_000)
    async with memory_pool(offline_world(), room, nodes) as pool:
        owner = await pool.start(JOB, OPTIONS)
        await gate.reached.wait()
        sums = await preview_from(pool, owner, 1, 10_000)
        state = await pool.state(JOB, owner)
        assert (state["phase"], state["preview"]) == ("rendering", 1)
        gate.opened.set()
        image, state = await pool.finished(JOB, owner)
    assert (sums[:, :, 3] == OPTIONS.samples).all()
    np.testing.assert_allclose(picture_of(sums), beauty_of(image), rtol=1e-5, atol=1e-6)
    assert nodes == 1 or min(node["closed"] for node in state["nodes"]) > 0, "nothing had to be added up"


async def test_an_image_is_the_same_however_often_somebody_looks(room: Records) -> None:
    async with memory_pool(offline_world(), room, 3) as pool:
        unseen, _ = await pool.render(1, OPTIONS)
        owner, seen = await pool.start(JOB, OPTIONS), 0
        while (await pool.state(JOB, owner))["phase"] in ("preparing", "rendering"):
            sums = await next_preview(pool, owner, seen + 1)
            if sums is None:
                continue
            seen += 1
            # While films are gathered some may count twice.
            assert 0 < sums[:, :, 3].sum() <= 2 * OPTIONS.plan.paths
        image, _ = await pool.finished(JOB, owner)
    assert seen >= 2 and sha256_of(image) == sha256_of(unseen)


async def test_it_is_made_when_it_shows_more_and_not_too_often(room: Records, gate: Gate, monkeypatch: pytest.MonkeyPatch) -> None:
    async with memory_pool(offline_world(), room, 2) as pool:
        owner = await pool.start(JOB, OPTIONS)
        await gate.reached.wait()
        assert (await refusal(pool, owner, 1, offset=16)).reason is RejectReason.NOT_READY
        assert (await refusal(pool, owner, 2)).reason is RejectReason.NOT_READY
        await preview_from(pool, owner, 1)
        await preview_from(pool, owner, 1)
        again = await refusal(pool, owner, 2)
        assert again.reason is RejectReason.NOT_READY and "nothing is done" in again.what
        monkeypatch.setattr(previewing, "PAUSE_S", 1000.0)
        assert "a moment ago" in (await refusal(pool, owner, 2)).what
        gate.opened.set()
        await pool.until(JOB, owner, "done")
        assert (await refusal(pool, owner, 2)).reason is RejectReason.NOT_READY
        await pool.ask(owner, CancelJob(job=JOB))


async def test_a_node_that_is_away_costs_the_preview_and_not_the_render(room: Records, gate: Gate) -> None:
    async with memory_pool(offline_world(), room, 3) as pool:
        owner = await pool.start(JOB, OPTIONS)
        await gate.reached.wait()
        other = next(node for node in pool.nodes if node != owner)
        pool.hosts[other].away = True
        assert (await refusal(pool, owner, 1)).reason is RejectReason.NOT_READY
        pool.hosts[other].away = False
        assert (await preview_from(pool, owner, 1))[:, :, 3].sum() == OPTIONS.plan.paths
        gate.opened.set()
        await pool.finished(JOB, owner)


class Liar(MemoryPool):
    """What nodes tell of previews, one another, is not what they have."""

    payload: bytes = b""
    total: int = 0

    async def deliver(self, peer: str, node: NodeId, packet: Packet) -> Packet | None:
        if isinstance(packet, FetchPreview) and peer.startswith("node:"):
            await trio.lowlevel.checkpoint()
            return ImagePart(job=packet.job, total_bytes=self.total, offset=packet.offset, payload=self.payload)
        return await super().deliver(peer, node, packet)


@pytest.mark.parametrize(
    ("payload", "total"),
    [
        (bytes(16), 32),
        (b"", preview_bytes(*SIZE)),
        (bytes(preview_bytes(*SIZE) + 16), preview_bytes(*SIZE)),
        (np.full(preview_bytes(*SIZE) // 4, np.nan, "<f4").tobytes(), preview_bytes(*SIZE)),
    ],
    ids=["another size", "nothing", "too much", "nonsense"],
)
async def test_nonsense_costs_the_preview_and_not_the_render(
    room: Records, gate: Gate, payload: bytes, total: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("scenefold.render.rehearsal.pool.MemoryPool", Liar)
    monkeypatch.setattr(Liar, "payload", payload)
    monkeypatch.setattr(Liar, "total", total)
    async with memory_pool(offline_world(), room, 2) as pool:
        owner = await pool.start(JOB, OPTIONS)
        await gate.reached.wait()
        assert (await refusal(pool, owner, 1)).reason is RejectReason.ILL_FORMED
        gate.opened.set()
        await pool.finished(JOB, owner)


async def test_without_memory_for_it_there_is_none(room: Records, gate: Gate, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(previewing, "COPIES", 1 << 20)
    async with memory_pool(offline_world(), room, 2) as pool:
        owner = await pool.start(JOB, OPTIONS)
        await gate.reached.wait()
        refused = await refusal(pool, owner, 1)
        assert refused.reason is RejectReason.OUTSIDE_BOUNDS and "a preview takes" in refused.what
        gate.opened.set()
        await pool.finished(JOB, owner)


async def test_nobody_else_is_shown_anything(room: Records, gate: Gate) -> None:
    look = FetchPreview(job=JOB, number=1, offset=0)
    async with memory_pool(offline_world(), room, 4) as pool:
        chosen = pool.nodes[:3]
        owner = await pool.start(JOB, OPTIONS, chosen)
        await gate.reached.wait()
        await preview_from(pool, owner, 1)
        place, outside = chosen.index(owner), pool.nodes[3]
        other = next(node for node in chosen if node != owner)
        asked = [("user:mallory", owner), ("user:mallory", other), ("user:test", other), (f"node:{outside}", owner)]
        # Nor may another node have the organiser, or a node farther from it, tell what it is not asked for.
        asked += [(f"node:{node}", owner) for node in chosen if node != owner]
        asked += [(f"node:{far}", near) for near, far in ((chosen[1], chosen[2]), (chosen[1], chosen[0])) if near != owner != far]
        for peer, node in asked:
            with pytest.raises(Refused):
                await pool.deliver(peer, node, look)
        assert (await preview_from(pool, owner, 1))[:, :, 3].sum() == OPTIONS.plan.paths and place >= 0
        gate.opened.set()
        await pool.finished(JOB, owner)


async def test_memory_is_given_back_at_once_and_for_the_next_attempt(room: Records, gate: Gate) -> None:
    async with memory_pool(offline_world(), room, 3) as pool:
        owner = await pool.start(JOB, OPTIONS)
        await gate.reached.wait()
        hosts = [pool.hosts[node].service.promises for node in pool.nodes]
        before = [promises.held for promises in hosts]
        await preview_from(pool, owner, 1)
        assert [promises.held for promises in hosts] == [held + preview_bytes(*SIZE) for held in before]
        part = pool.hosts[owner].service._part(JOB)
        part.previewing.forget()
        assert pool.hosts[owner].service.promises.held == before[pool.nodes.index(owner)]
        assert (await refusal(pool, owner, 1)).reason is RejectReason.NOT_READY
        # What it shows counts from nothing in the next attempt.
        await preview_from(pool, owner, 2)
        gate.opened.set()
        await pool.finished(JOB, owner)


async def test_one_is_made_at_a_time_and_not_for_ever(room: Records, gate: Gate, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(previewing, "MAKE_S_MAX", 0.5)
    asked = trio.Event()

    class Deaf(MemoryPool):
        async def deliver(self, peer: str, node: NodeId, packet: Packet) -> Packet | None:
            if isinstance(packet, FetchPreview) and peer.startswith("node:"):
                asked.set()
                await trio.sleep_forever()
            return await super().deliver(peer, node, packet)

    monkeypatch.setattr("scenefold.render.rehearsal.pool.MemoryPool", Deaf)
    async with memory_pool(offline_world(), room, 2) as pool:
        owner = await pool.start(JOB, OPTIONS)
        await gate.reached.wait()
        before = pool.hosts[owner].service.promises.held
        async with trio.open_nursery() as nursery:

            async def late() -> None:
                assert "in time" in (await refusal(pool, owner, 1)).what

            nursery.start_soon(late)
            await asked.wait()
            assert (await refusal(pool, owner, 1)).reason is RejectReason.BUSY
        assert pool.hosts[owner].service.promises.held == before
        gate.opened.set()
        await pool.finished(JOB, owner)


async def test_levels_and_kept_films_are_in_it(room: Records) -> None:
    """What was gathered is in the organiser's film, and in no other any more."""
    options = replace(OPTIONS, samples=512, adaptive=Adaptive(0.05, 16))
    totals: list[float] = []
    async with memory_pool(offline_world(), room, 3) as pool:
        owner = await pool.start(JOB, options, keep=Keep())
        state: dict[str, Any] = {"phase": "preparing"}
        while state["phase"] in ("preparing", "rendering"):
            sums = await next_preview(pool, owner, len(totals) + 1)
            if sums is not None:
                totals.append(float(sums[:, :, 3].sum()))
            state = await pool.state(JOB, owner)
        _, state = await pool.finished(JOB, owner)
    assert len(totals) >= 2 and max(totals) <= 2 * state["paths"]
