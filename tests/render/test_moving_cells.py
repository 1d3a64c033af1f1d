"""If this fails, cells that move change the image, lose rays, or never move; or anybody but the organiser moves them."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import pytest
import trio
import trio.testing

from scenefold.base.errors import LocalFault, PeerFault, Refused
from scenefold.base.ids import NodeId
from scenefold.partition import Partition
from scenefold.partition.division import Division
from scenefold.render.algorithms import ALGORITHMS, RESTING, WHOLE
from scenefold.render.job import RenderOptions
from scenefold.render.pool import organiser
from scenefold.render.pool.cell import Cell
from scenefold.render.rehearsal.pool import MemoryPool, Records, memory_pool, sha256_of
from scenefold.wire import JobEvent, Packet, SendRays, pack_value, unpack_value
from scenefold.world.real.world import offline_world

OPTIONS = RenderOptions(width=96, height=72, samples=24, seed=3, sky=(0.2, 0.3, 0.5))
JOB = 11
NODES = 5
PASSES_BEFORE = 4
"""More of them than the first round of rays needs."""


@pytest.fixture(autouse=True)
def looks_often(monkeypatch: pytest.MonkeyPatch) -> None:
    """These jobs are short."""
    monkeypatch.setattr(organiser, "POLL_S", 0.01)


@pytest.fixture(scope="module")
def alone(room: Records) -> str:
    async def render() -> str:
        async with memory_pool(offline_world(), room, 1) as pool:
            image, _ = await pool.render(JOB, OPTIONS)
        return sha256_of(image)

    return trio.run(render)


async def _rendered(pool: MemoryPool, options: RenderOptions) -> tuple[str, dict[str, Any]]:
    image, state = await pool.render(JOB, options)
    return sha256_of(image), state


@pytest.mark.usefixtures("ends_moved")
@pytest.mark.parametrize("algorithm", [name for name in ALGORITHMS if name not in (RESTING, WHOLE)])
async def test_cells_move_and_no_bit_does(room: Records, alone: str, algorithm: str) -> None:
    async with memory_pool(offline_world(), room, NODES) as pool:
        image, state = await _rendered(pool, replace(OPTIONS, algorithm=algorithm))
    assert image == alone
    assert state["moved"] >= 1
    # The last move may still have been on its way to some of them.
    assert max(node["epoch"] for node in state["nodes"]) >= 1 + state["moved"]


@pytest.mark.parametrize("options", [replace(OPTIONS, moving=False), replace(OPTIONS, algorithm=RESTING)], ids=["fixed", "voronoi"])
async def test_cells_stay_where_they_are_to_stay(room: Records, alone: str, options: RenderOptions) -> None:
    async with memory_pool(offline_world(), room, NODES) as pool:
        image, state = await _rendered(pool, options)
    assert image == alone and state["moved"] == 0
    assert {node["epoch"] for node in state["nodes"]} == {1}


def _event_of(packet: Packet) -> dict[str, Any]:
    found = unpack_value(packet.document, what="an event") if isinstance(packet, JobEvent) else {}
    assert isinstance(found, dict)
    return found


@pytest.mark.usefixtures("ends_moved")
async def test_who_hears_late_of_a_move_claims_with_the_first_rays(room: Records, alone: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first node alone is told to claim, until rays of the new epoch are on their way; later passes have to wait for that."""
    told, rays = trio.Event(), trio.Event()
    plain = MemoryPool.deliver

    async def deliver(self: MemoryPool, peer: str, node: NodeId, packet: Packet) -> Packet | None:
        if "claim" in _event_of(packet):
            told.set()
            if node != self.nodes[0]:
                await rays.wait()
        if isinstance(packet, SendRays):
            if any(batch.partition_epoch > 1 for batch in packet.batches):
                assert told.is_set()
                rays.set()
            elif any(batch.pass_index >= PASSES_BEFORE for batch in packet.batches):
                await told.wait()
        return await plain(self, peer, node, packet)

    monkeypatch.setattr(MemoryPool, "deliver", deliver)
    async with memory_pool(offline_world(), room, NODES) as pool:
        image, state = await _rendered(pool, replace(OPTIONS, algorithm="kd"))
    assert image == alone and state["moved"] >= 1
    assert rays.is_set()


@pytest.mark.expect_log("cells stay where they are from now on: no memory for more")
async def test_a_node_that_cannot_fetch_leaves_all_cells_where_they_are(room: Records, alone: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """All load their first share; what follows they refuse."""

    async def fetch(_self: object, *_args: object) -> object:
        raise LocalFault("no memory for more")

    monkeypatch.setattr("scenefold.render.pool.moving.Moving._moved", fetch)
    async with memory_pool(offline_world(), room, NODES) as pool:
        image, state = await _rendered(pool, replace(OPTIONS, algorithm="kd"))
        told = [_decoded(one) for one in pool.delivered[pool.nodes[-1]]]
    assert image == alone and state["moved"] == 0
    assert [event for event in told if "forget" in event] == [{"forget": 2}], "told once, and no further move is tried"


def _decoded(packet: bytes) -> dict[str, Any]:
    from scenefold.wire import decode_packet

    return _event_of(decode_packet(packet))


@pytest.mark.expect_log("their rule failed, ZeroDivisionError")
async def test_a_rule_that_fails_leaves_all_cells_where_they_are(room: Records, alone: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def rule(*_args: object) -> Partition:
        raise ZeroDivisionError

    monkeypatch.setattr(organiser, "rule_of", lambda _name: rule)
    async with memory_pool(offline_world(), room, NODES) as pool:
        image, state = await _rendered(pool, OPTIONS)
    assert image == alone and state["moved"] == 0


async def test_nobody_but_the_organiser_moves_cells(room: Records) -> None:
    options = replace(OPTIONS, width=320, height=240, samples=64, moving=False)
    async with memory_pool(offline_world(), room, 3) as pool:
        owner = await pool.start(JOB, options)
        await pool.until(JOB, owner, "rendering")
        victim, stranger = (node for node in pool.nodes if node != owner)
        ask = partial(pool.deliver, f"node:{stranger}", victim)
        cells = Partition.voronoi([[0, 0, 0], [0.1, 0, 0], [0.2, 0, 0]], epoch=2)
        for document in ({"fetch": cells.to_document()}, {"claim": 2}, {"forget": 2}):
            with pytest.raises(Refused, match="does not organise"):
                await ask(JobEvent(job=JOB, document=pack_value(document)))
        ask = partial(pool.deliver, f"node:{owner}", victim)
        with pytest.raises(PeerFault, match="no such cell was fetched"):
            await ask(JobEvent(job=JOB, document=pack_value({"claim": 2})))
        for wrong in ({"epoch": 2}, cells.with_epoch(1).to_document(), Partition.voronoi([[0, 0, 0]], epoch=2).to_document()):
            answer = await ask(JobEvent(job=JOB, document=pack_value({"fetch": wrong})))
            assert answer is not None and answer.reason  # type: ignore[attr-defined]
        with pytest.raises(PeerFault, match="whole number"):
            await ask(JobEvent(job=JOB, document=pack_value({"claim": "soon"})))


@pytest.mark.usefixtures("ends_moved")
async def test_what_a_job_held_is_closed_when_it_ends(room: Records, monkeypatch: pytest.MonkeyPatch) -> None:
    """Scenes that were opened for moves, too."""
    from scenefold.render.renderers.embree.renderer import EmbreeScene

    opened: list[object] = []
    closed = trio.Event()
    plain_open, plain_close = EmbreeScene.__init__, EmbreeScene.close

    def init(self: EmbreeScene, *args: Any, **options: Any) -> None:
        plain_open(self, *args, **options)
        opened.append(self)

    def close(self: EmbreeScene) -> None:
        opened.remove(self)
        plain_close(self)
        if not opened:
            trio.from_thread.run_sync(closed.set)

    monkeypatch.setattr(EmbreeScene, "__init__", init)
    monkeypatch.setattr(EmbreeScene, "close", close)
    async with memory_pool(offline_world(), room, NODES) as pool:
        _, state = await _rendered(pool, replace(OPTIONS, algorithm="kd"))
        with trio.fail_after(30):
            await closed.wait()
    assert not opened
    assert state["moved"] >= 1


async def test_a_cell_is_left_when_its_last_tracer_rests() -> None:
    """By everybody who waits for it."""
    cell = Cell(Division((Partition.voronoi([[0.0, 0.0, 0.0]]),)), 0, [])
    await cell.at_rest()
    left: list[str] = []

    async def leave() -> None:
        await cell.at_rest()
        left.append("left")

    async with trio.open_nursery() as nursery:
        with cell.at_work():
            with cell.at_work():
                nursery.start_soon(leave)
                await trio.testing.wait_all_tasks_blocked()
                nursery.start_soon(leave)
                await trio.testing.wait_all_tasks_blocked()
            await trio.testing.wait_all_tasks_blocked()
            assert not left
    assert left == ["left", "left"]


def test_a_renderer_that_cannot_address_rays_anew_says_so() -> None:
    cells = Partition.voronoi([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    assert not Cell(Division((cells,)), 0, [object()]).can_route  # type: ignore[list-item]
