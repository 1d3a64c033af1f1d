"""If this fails, nodes that each hold the whole scene pass rays on all the same, make another image, or wait for the slowest of them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
import trio

from render.test_resume import interrupted, resumed
from scenefold.base.errors import Refused
from scenefold.base.ids import address_of
from scenefold.base.rays import RAY_BYTES
from scenefold.partition.division import Division
from scenefold.render.job import RenderOptions
from scenefold.render.ledger import Counts
from scenefold.render.levels import Adaptive
from scenefold.render.passes import PassPlan
from scenefold.render.pool import dealing, organiser
from scenefold.render.pool.cell import Cell
from scenefold.render.pool.dividing import EVERYTHING
from scenefold.render.pool.member import Member
from scenefold.render.pool.own_passes import pass_owner
from scenefold.render.pool.request import organiser_of
from scenefold.render.rehearsal.faults import Faults, FaultyPool
from scenefold.render.rehearsal.pool import MemoryHost, MemoryPool, Records, memory_pool, running, sha256_of
from scenefold.render.renderers.embree.renderer import EmbreeScene
from scenefold.wire import CancelJob, RayBatch, SendRays
from scenefold.world.real.world import offline_world

OPTIONS = RenderOptions(width=96, height=72, samples=160, seed=3, sky=(0.2, 0.3, 0.5), depth=4, algorithm="whole")
"""17 passes."""
PATHS = 96 * 72 * 160
JOB = 11


@pytest.fixture(autouse=True)
def looks_often(monkeypatch: pytest.MonkeyPatch) -> None:
    """These jobs are short."""
    monkeypatch.setattr(organiser, "POLL_S", 0.01)


@pytest.fixture(scope="module")
def alone(room: Records) -> str:
    """Of what one node makes."""

    async def render() -> str:
        async with memory_pool(offline_world(), room, 1) as pool:
            image, _ = await pool.render(JOB, replace(OPTIONS, algorithm="voronoi"))
        return sha256_of(image)

    return trio.run(render)


@pytest.mark.usefixtures("all_help")
@pytest.mark.parametrize("nodes", [1, 2, 5])
async def test_the_image_is_the_same_and_no_ray_leaves_its_node(room: Records, alone: str, nodes: int) -> None:
    async with memory_pool(offline_world(), room, nodes) as pool:
        image, state = await pool.render(JOB, OPTIONS)
    assert sha256_of(image) == alone
    told = state["nodes"]
    # Each holds all of it, and only camera rays went from one to another.
    assert len({node["triangles"] for node in told}) == 1 and told[0]["triangles"] > 0
    sent = sum(node["rays_sent"] for node in told)
    assert sent == sum(node["rays_received"] for node in told)
    assert (0 < sent < PATHS) if nodes > 1 else sent == 0
    assert sum(node["casts"] for node in told) == sum(node["rays"] for node in told)
    assert min(node["casts"] for node in told) > 0
    assert state["moved"] == 0 and state["closed"] == 17


async def test_an_owner_traces_its_passes_by_itself_while_the_others_have_some(room: Records, alone: str) -> None:
    async with memory_pool(offline_world(), room, 3) as pool:
        image, state = await pool.render(JOB, OPTIONS)
    assert sha256_of(image) == alone
    # At the end those who are done may help.
    assert sum(node["rays_sent"] for node in state["nodes"]) < PATHS / 3
    assert min(node["casts"] for node in state["nodes"]) > 0


async def test_whoever_owns_no_pass_helps(room: Records, monkeypatch: pytest.MonkeyPatch) -> None:
    """One pass, three nodes; the way to another one is left out, as the pass takes less."""
    monkeypatch.setattr(dealing, "TRIP_S", 0.0)
    options = replace(OPTIONS, samples=9)
    images = []
    for nodes in (1, 3):
        async with memory_pool(offline_world(), room, nodes) as pool:
            image, state = await pool.render(JOB, options)
        images.append(sha256_of(image))
    assert images[0] == images[1]
    paths = 96 * 72 * 9
    assert sorted(node["rays_received"] for node in state["nodes"]) == [0, paths // 3, paths // 3]


@pytest.mark.usefixtures("all_help")
@pytest.mark.parametrize("faults", [Faults(lost=0.2), Faults(doubled=0.2, late=0.3)], ids=["lost", "doubled and late"])
async def test_whatever_the_network_does(room: Records, alone: str, faults: Faults) -> None:
    async with running(FaultyPool(offline_world(), room, 3, faults)) as pool:
        image, state = await pool.render(JOB, OPTIONS)
    assert sha256_of(image) == alone
    assert not faults.lost or (pool.dropped and sum(node["packets_resent"] for node in state["nodes"]))


async def test_nobody_has_a_pass_closed_of_which_it_was_dealt_nothing(room: Records, alone: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """It says that it made rays, so that what all say balances, and is to be collected, again and again."""
    members: list[Member] = []
    run = Member.run

    async def noted(self: Member) -> None:
        members.append(self)
        await run(self)

    monkeypatch.setattr(Member, "run", noted)
    async with memory_pool(offline_world(), room, 2) as pool:
        owner = await pool.start(JOB, OPTIONS)
        while len(members) < 2:
            await pool.world.clock.sleep(0.005)
        (first,) = (member for member in members if not member._me)
        for number in range(PassPlan(JOB, PATHS).count):
            first._report(1, number, Counts(created=1, retired=1))
        with trio.fail_after(60.0):
            image, state = await pool.finished(JOB, owner)
    assert sha256_of(image) == alone and state["attempts"] == 1


async def test_dealt_paths_come_from_who_owns_them(room: Records) -> None:
    async with memory_pool(offline_world(), room, 3) as pool:
        owner = await pool.start(JOB, OPTIONS)
        await pool.until(JOB, owner, "rendering")
        plan = PassPlan(JOB, PATHS)
        number = next(number for number in range(plan.count) if pass_owner(plan, number, 3) == 2)
        forged = SendRays(JOB, 0, 0, 90, 0, b"", (), (), (), (RayBatch(number, 0, 1),), bytes(RAY_BYTES))
        with pytest.raises(Refused, match="dealt by the owner"):
            await pool.deliver(f"node:{pool.nodes[1]}", pool.nodes[0], forged)
        # The link between the two has counted that, and is of no use any more.
        await pool.ask(owner, CancelJob(job=JOB))


@pytest.mark.usefixtures("all_help")
async def test_threads_share_what_a_node_is_dealt(room: Records, alone: str) -> None:
    async with memory_pool(offline_world(lanes={"render": 3}), room, 2) as pool:
        for host in pool.hosts.values():
            host.render_threads = 3
        image, _ = await pool.render(JOB, OPTIONS)
    assert sha256_of(image) == alone


@pytest.mark.usefixtures("all_help")
@pytest.mark.expect_log("nodes go on")
async def test_a_node_dies_and_the_others_get_its_paths(room: Records, alone: str) -> None:
    async with memory_pool(offline_world(), room, 3) as pool:
        owner = await pool.start(JOB, OPTIONS)
        while (await pool.state(JOB, owner))["closed"] < 3:
            await pool.world.clock.sleep(0.005)
        victim = next(node for node in pool.nodes if node != organiser_of(JOB, pool.nodes))
        read = {node["address"]: node["bytes_read"] for node in (await pool.state(JOB, owner))["nodes"]}
        pool.kill(victim)
        image, state = await pool.finished(JOB, owner)
    assert state["lost"] == [address_of(victim)] and state["attempts"] == 2
    # Nobody had to read anything for that.
    assert all(node["bytes_read"] == read[node["address"]] for node in state["nodes"])
    assert sha256_of(image) == alone


@pytest.mark.parametrize("help_from_all", [False, True], ids=["alone", "dealt"])
async def test_levels(room: Records, help_from_all: bool, request: pytest.FixtureRequest) -> None:
    if help_from_all:
        request.getfixturevalue("all_help")
    options = replace(OPTIONS, samples=256, adaptive=Adaptive(0.15, 16))
    images = []
    for nodes in (1, 3):
        async with memory_pool(offline_world(), room, nodes) as pool:
            image, _ = await pool.render(JOB, options)
            images.append(sha256_of(image))
    assert images[0] == images[1]


async def test_a_kept_film_goes_on_with_cells_and_without(room: Records, alone: str) -> None:
    for before, after in (("whole", "voronoi"), ("voronoi", "whole")):
        keep, film = await interrupted(room, replace(OPTIONS, algorithm=before), 2)
        image, state = await resumed(room, replace(OPTIONS, algorithm=after), 3, keep, film)
        assert sha256_of(image) == alone
        assert state["paths_before"] > 0


async def test_who_is_slow_gets_fewer_paths(room: Records, monkeypatch: pytest.MonkeyPatch) -> None:
    """One of two takes twenty times as long for what it traces."""
    monkeypatch.setattr(dealing, "TRIP_S", 0.01)
    async with running(SlowPool(offline_world(), room, 2)) as pool:
        image, state = await pool.render(JOB, replace(OPTIONS, samples=320))
    by_address = {node["address"]: node for node in state["nodes"]}
    quick, slow = (by_address[address_of(node)] for node in pool.nodes)
    assert slow["casts"] < quick["casts"] / 2
    async with memory_pool(offline_world(), room, 1) as pool:
        assert sha256_of(image) == sha256_of((await pool.render(JOB, replace(OPTIONS, samples=320)))[0])


class SlowPool(MemoryPool):
    """Whose last node traces slowly."""

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        host = self.hosts[self.nodes[-1]]
        host.world = replace(host.world, workers=_Slow(host.world.workers, host.world.clock))


class _Slow:
    """Worker threads in which tracing takes twenty times as long."""

    def __init__(self, workers: Any, clock: Any) -> None:
        self._workers, self._clock = workers, clock

    async def run(self, lane: str, function: Any, *args: Any) -> Any:
        begun = self._clock.now()
        result = await self._workers.run(lane, function, *args)
        if getattr(function, "__name__", "") == "advanced":
            await self._clock.sleep(19 * (self._clock.now() - begun))
        return result


async def test_a_scene_that_is_too_large_for_a_node_is_refused_with_what_to_do(room: Records, monkeypatch: pytest.MonkeyPatch) -> None:
    async with memory_pool(offline_world(), room, 2) as pool:
        monkeypatch.setattr("scenefold.render.pool.share.TRIANGLE_BYTES", MemoryHost.memory_bytes)
        owner = await pool.start(JOB, OPTIONS)
        state = await pool.until(JOB, owner, "done", "failed")
        assert state["phase"] == "failed" and "the whole scene takes some" in state["failure"] and "another --algorithm" in state["failure"]


async def test_a_renderer_whose_rays_cannot_be_addressed_anew_is_refused(room: Records, monkeypatch: pytest.MonkeyPatch) -> None:
    """What becomes of its rays may depend on which others are traced with them."""
    plain = EmbreeScene.tracers
    monkeypatch.setattr(EmbreeScene, "tracers", lambda self, count: [_Plain(tracer) for tracer in plain(self, count)])
    async with memory_pool(offline_world(), room, 2) as pool:
        owner = await pool.start(JOB, OPTIONS)
        state = await pool.until(JOB, owner, "done", "failed")
    assert state["phase"] == "failed" and "paths cannot be dealt" in state["failure"]


class _Plain:
    """A tracer that does no more than it must."""

    def __init__(self, tracer: Any) -> None:
        self.generate, self.advance = tracer.generate, tracer.advance


async def test_what_was_addressed_by_older_cells_stays_with_who_holds_everything() -> None:
    cell = Cell(Division((EVERYTHING,) * 5), 3, [])
    assert cell.can_route
    assert cell.route("rays") == {3: "rays"}  # type: ignore[arg-type,comparison-overlap]
