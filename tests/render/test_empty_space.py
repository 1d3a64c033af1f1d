"""If this fails, nodes pass rays over geometry, or to cells where there is nothing, or over what somebody put there meanwhile."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import trio

from render.test_render_pools import after_a_comeback
from scenefold.base.errors import PeerFault, Refused
from scenefold.base.ids import NodeId, address_of
from scenefold.partition import Partition
from scenefold.render.arrays import NOTHING_KNOWN
from scenefold.render.job import RenderOptions
from scenefold.render.occupied import packed, pieces_of, unpacked
from scenefold.render.pool import organiser
from scenefold.render.pool.emptiness import Emptiness
from scenefold.render.pool.share import read_tables
from scenefold.render.rehearsal.pool import MemoryPool, MemoryReader, Records, memory_pool, sha256_of
from scenefold.render.renderers.embree.tracer import EmbreeTracer
from scenefold.wire import CancelJob
from scenefold.world.real.world import offline_world

OPTIONS = RenderOptions(width=96, height=72, samples=24, seed=3, sky=(0.2, 0.3, 0.5), algorithm="kd", moving=False, skips=True)
LONG = replace(OPTIONS, samples=2_000)
"""It is not over before it is looked at."""
JOB = 11
NODES = 5


@pytest.fixture(autouse=True)
def looks_often(monkeypatch: pytest.MonkeyPatch) -> None:
    """These jobs are short."""
    monkeypatch.setattr(organiser, "POLL_S", 0.01)


@pytest.fixture
def knowing(monkeypatch: pytest.MonkeyPatch) -> list[EmbreeTracer]:
    """Tracers that were told where there is nothing, in their order."""
    told: list[EmbreeTracer] = []
    skip = EmbreeTracer.skip

    def noted(self: EmbreeTracer, empty: Any) -> None:
        told.append(self)
        skip(self, empty)

    monkeypatch.setattr(EmbreeTracer, "skip", noted)
    return told


async def rendered(room: Records, nodes: int, options: RenderOptions = OPTIONS) -> tuple[str, int, dict[str, Any]]:
    """The image, rays that were passed on, and the last state."""
    async with memory_pool(offline_world(), room, nodes) as pool:
        image, state = await pool.render(JOB, options)
    return sha256_of(image), sum(node["rays_sent"] for node in state["nodes"]), state


@pytest.fixture(scope="module")
def alone(room: Records) -> str:
    """Of what one node makes."""
    return trio.run(rendered, room, 1)[0]


async def test_rays_are_passed_over_what_is_empty(
    room: Records, alone: str, knowing: list[EmbreeTracer], monkeypatch: pytest.MonkeyPatch
) -> None:
    image, skipped, state = await rendered(room, NODES)
    assert len(knowing) == NODES
    assert "occupied" not in str(state["nodes"]), "nobody else needs to know"
    # It has to be asked for; and where a node tells nothing, nobody skips anything.
    knowing.clear()
    usual, passed, _ = await rendered(room, NODES, replace(OPTIONS, skips=False))
    assert not knowing and usual == alone

    async def tells_nothing(self: Emptiness, *_: object) -> None:
        """As a node whose renderer cannot skip."""

    monkeypatch.setattr(Emptiness, "find", tells_nothing)
    plain, _, _ = await rendered(room, NODES)
    assert not knowing
    assert image == plain == alone
    assert skipped < 0.9 * passed


async def test_who_is_alone_needs_to_know_nothing(room: Records, knowing: list[EmbreeTracer]) -> None:
    await rendered(room, 1)
    await rendered(room, 3, replace(OPTIONS, algorithm="whole"))
    assert not knowing


async def test_pools_of_which_one_has_a_single_node_know_it_too(room: Records, alone: str, knowing: list[EmbreeTracer]) -> None:
    image, _, state = await rendered(room, 3, replace(OPTIONS, pools=2))
    assert image == alone and state["pools"] == 2
    assert len(knowing) == 3


@pytest.mark.usefixtures("ends_moved")
async def test_cells_that_moved_know_it(room: Records, alone: str, knowing: list[EmbreeTracer]) -> None:
    image, _, state = await rendered(room, NODES, replace(OPTIONS, moving=True))
    assert image == alone and state["moved"] >= 1
    assert len(knowing) >= 2 * NODES


@pytest.mark.expect_log("go on")
async def test_who_comes_back_knows_it(room: Records, knowing: list[EmbreeTracer], monkeypatch: pytest.MonkeyPatch) -> None:
    async with memory_pool(offline_world(), room, 3) as pool:
        _, state, victim = await after_a_comeback(pool, replace(OPTIONS, samples=320), monkeypatch)
        assert state["back"] == [address_of(victim)]
    assert all(tracer._empty is not NOTHING_KNOWN for tracer in knowing)
    # Three at first, two that carved up the third one's cell, who came back, in its first cell, and those whose cells of a fresh division are others.
    assert len(knowing) >= 8


async def tracing(pool: MemoryPool) -> NodeId:
    """Who organises a job that goes on for long, of which a pass is closed."""
    owner = await pool.start(JOB, LONG)
    while not (await pool.state(JOB, owner))["closed"]:
        await pool.world.clock.sleep(0.005)
    return owner


async def test_what_was_put_where_nothing_was_is_noticed(room: Records) -> None:
    async with memory_pool(offline_world(), room, 2) as pool:
        owner = await tracing(pool)
        moving = pool.hosts[pool.nodes[0]].service._part(JOB)._moving
        assert moving.held is not None
        emptiness, held = moving.emptiness, moving.held
        partition = held.cell.division.pools[0]
        await emptiness.check(held.loaded, partition, 0)
        assert emptiness._occupied is not None
        known = emptiness._occupied.copy()
        known.reshape(-1)[np.flatnonzero(known)[0]] = 0
        emptiness._occupied = known
        with pytest.raises(Refused, match="changed while it is rendered"):
            await emptiness.check(held.loaded, partition, 0)
        await pool.ask(owner, CancelJob(job=JOB))


async def test_who_holds_something_where_nothing_is_said_to_be_begins_nothing(room: Records) -> None:
    """It read its cell before or behind an edit, and another node did not."""
    async with memory_pool(offline_world(), room, 2) as pool:
        owner = await tracing(pool)
        moving = pool.hosts[pool.nodes[0]].service._part(JOB)._moving
        assert moving.held is not None
        emptiness, held = moving.emptiness, moving.held
        await emptiness.find(held.loaded, held.cell.division.pools[0], 0, held.cell.tracers)
        mine = unpacked(emptiness.told)
        less = mine.copy()
        less.reshape(-1)[np.flatnonzero(mine)[-1]] = 0
        with pytest.raises(Refused, match="changed while it is rendered"):
            await emptiness.see(packed(less), held.loaded, held.cell.tracers)
        await emptiness.see(packed(mine), held.loaded, held.cell.tracers)
        await pool.ask(owner, CancelJob(job=JOB))


def test_a_large_share_is_marked_in_pieces(room: Records, monkeypatch: pytest.MonkeyPatch) -> None:
    """A worker cannot be interrupted."""
    tables = trio.run(read_tables, MemoryReader(room), offline_world().workers)
    partition = Partition.voronoi([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]])
    (piece,) = pieces_of(tables, partition, 0)
    monkeypatch.setattr("scenefold.render.occupied.PIECE_TRIANGLES", 1)
    pieces = pieces_of(tables, partition, 0)
    assert [group for some in pieces for group in some.groups.tolist()] == piece.groups.tolist()
    assert np.concatenate([some.dilations for some in pieces]).tolist() == piece.dilations.tolist()


@pytest.mark.parametrize("occupied", [7, b"no voxels", "voxels"])
async def test_what_is_no_word_of_empty_space_is_none(room: Records, occupied: object) -> None:
    async with memory_pool(offline_world(), room, 2) as pool:
        owner = await tracing(pool)
        part = pool.hosts[pool.nodes[0]].service._part(JOB)
        with pytest.raises(PeerFault, match="ill-formed"):
            await part.go(0, occupied)
        await pool.ask(owner, CancelJob(job=JOB))
