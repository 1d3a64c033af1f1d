"""If this fails, nodes that hold a scene in several pools make another image, pass rays from pool to pool, or form pools that do not hold it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any
from unittest.mock import patch

import pytest
import trio

from render import shapes
from render.test_resume import interrupted, resumed
from scenefold.base.errors import PeerFault, Refused
from scenefold.base.ids import NodeId, address_of
from scenefold.base.rays import RAY_BYTES
from scenefold.base.reasons import RejectReason
from scenefold.partition import Partition
from scenefold.partition.division import Division
from scenefold.render.algorithms import ALGORITHMS, RESTING, WHOLE
from scenefold.render.job import POOLS_THAT_FIT, RenderOptions
from scenefold.render.levels import Adaptive
from scenefold.render.passes import PassPlan
from scenefold.render.pool import comebacks, organiser, share
from scenefold.render.pool.budgets import budget_document, budget_told
from scenefold.render.pool.dividing import Dividing, Standing
from scenefold.render.pool.image_memory import image_needs
from scenefold.render.pool.member import Member
from scenefold.render.pool.own_passes import pass_owner
from scenefold.render.pool.request import organiser_of
from scenefold.render.pool.share import read_tables
from scenefold.render.rehearsal.faults import Faults, FaultyPool
from scenefold.render.rehearsal.pool import MemoryHost, MemoryPool, MemoryReader, Records, memory_pool, running, sha256_of
from scenefold.render.renderers.embree.renderer import EmbreeRenderer
from scenefold.scene.importers import atoms, prototypes
from scenefold.scene.importers.plan import ImportPlan
from scenefold.scene.payloads.materials import Material
from scenefold.wire import CancelJob, JobAnswer, JobState, JobStateReply, Packet, RayBatch, SendRays, StartJob, pack_value, unpack_value
from scenefold.world.real.world import offline_world

OPTIONS = RenderOptions(width=96, height=72, samples=160, seed=3, sky=(0.2, 0.3, 0.5), depth=4, algorithm="kd", pools=2)
"""17 passes."""
PATHS = 96 * 72 * 160
JOB = 11
MOVED = ("kd", "bounded-radial", "swarming")
"""Of each kind one; tests of cells that move have the others, in one pool."""
IMAGE = image_needs(96 * 72, OPTIONS.layers, 5, is_adaptive=False)


@pytest.fixture(autouse=True)
def looks_often(monkeypatch: pytest.MonkeyPatch) -> None:
    """These jobs are short."""
    monkeypatch.setattr(organiser, "POLL_S", 0.01)


@pytest.fixture(scope="module")
def room() -> Records:
    """A lamp above balls in a row, in small groups: a cell of so many has about so much of it."""
    materials = [Material(base_color=(0.7, 0.6, 0.5, 1.0)), Material(emissive=(9.0, 9.0, 9.0))]
    balls = [[shapes.ball((x, 0.0, 0.0), 0.45, 5, 0, smooth=True)] for x in range(-8, 8)]
    lamp = [shapes.grid((-1, 3, -1), (2, 0, 0), (0, 0, 2), 1, 1)]
    source = shapes.scene([*balls, lamp], materials, [shapes.looking((0, 2, 9), (0, 0, 0))])
    with (
        patch.object(atoms, "GROUP_TRIANGLES_TARGET", 40),
        patch.object(atoms, "ATOM_TRIANGLES_MAX", 10),
        patch.object(prototypes, "BAKED_COPIES_TRIANGLES_MAX", 0),
    ):
        items = [item for phase in ImportPlan(source).phases() for item in phase]
    records = {(item.space, item.location): item.payload for item in items}
    assert len(records) == len(items), "no two lie at one place"
    return records


@pytest.fixture(scope="module")
def alone(room: Records) -> str:
    """Of what one node makes."""

    async def render() -> str:
        async with memory_pool(offline_world(), room, 1) as pool:
            image, _ = await pool.render(JOB, OPTIONS)
        return sha256_of(image)

    return trio.run(render)


@pytest.fixture
def heavy(monkeypatch: pytest.MonkeyPatch) -> None:
    """Triangles are what takes memory, and not the image."""
    monkeypatch.setattr(share, "TRIANGLE_BYTES", 200_000)


@pytest.fixture
def senders(monkeypatch: pytest.MonkeyPatch) -> set[tuple[NodeId, NodeId]]:
    """Who sent whom rays that the receiver had to address anew, or could trace as they were, in which pass, if that one was not the sender's."""
    between: set[tuple[NodeId, NodeId]] = set()
    on_rays = Member.on_rays

    def noted(self: Member, node: int, packet: SendRays) -> None:
        nodes = self._roster.nodes
        if any(pass_owner(self._plan, batch.pass_index, len(nodes)) != node for batch in packet.batches):
            between.add((nodes[node], nodes[self._me]))
        on_rays(self, node, packet)

    monkeypatch.setattr(Member, "on_rays", noted)
    return between


async def test_rays_of_others_passes_stay_in_a_pool(room: Records, alone: str, senders: set[tuple[NodeId, NodeId]]) -> None:
    async with memory_pool(offline_world(), room, 5) as pool:
        image, state = await pool.render(JOB, OPTIONS)
        pools = pool.nodes[:3], pool.nodes[3:]
    assert sha256_of(image) == alone
    assert state["pools"] == 2 and state["closed"] == 17
    assert senders
    for sender, receiver in senders:
        assert any(sender in some and receiver in some for some in pools)
    told = {node["address"]: node for node in state["nodes"]}
    for some in pools:
        # Together they hold all of it, and what lies on both sides of a cell's wall twice.
        assert sum(told[address_of(node)]["triangles"] for node in some) >= max(node["triangles"] for node in state["nodes"])
    assert min(node["casts"] for node in state["nodes"]) > 0
    assert sum(node["rays_sent"] for node in state["nodes"]) == sum(node["rays_received"] for node in state["nodes"])


@pytest.mark.usefixtures("all_help")
@pytest.mark.parametrize(("nodes", "pools"), [(2, 2), (5, 2), (5, 3), (4, 4), (3, 99)])
async def test_what_pools_deal_each_other_is_the_same_image(room: Records, alone: str, nodes: int, pools: int) -> None:
    async with memory_pool(offline_world(), room, nodes) as pool:
        image, state = await pool.render(JOB, replace(OPTIONS, pools=pools))
    assert sha256_of(image) == alone
    assert state["pools"] == min(nodes, pools)
    assert min(node["rays_received"] for node in state["nodes"]) > 0


@pytest.mark.usefixtures("ends_moved")
@pytest.mark.parametrize(
    "algorithm",
    [pytest.param(name, marks=() if name in MOVED else pytest.mark.long) for name in ALGORITHMS if name not in (RESTING, WHOLE)],
)
async def test_each_pool_moves_its_cells(room: Records, alone: str, algorithm: str) -> None:
    async with memory_pool(offline_world(), room, 5) as pool:
        image, state = await pool.render(JOB, replace(OPTIONS, algorithm=algorithm))
    assert sha256_of(image) == alone
    assert state["moved"] >= 1 and state["pools"] == 2


@pytest.mark.usefixtures("all_help")
@pytest.mark.parametrize(
    "faults",
    [pytest.param(Faults(lost=0.2), marks=pytest.mark.long, id="lost"), pytest.param(Faults(doubled=0.2, late=0.3), id="doubled and late")],
)
async def test_whatever_the_network_does(room: Records, alone: str, faults: Faults) -> None:
    async with running(FaultyPool(offline_world(), room, 5, faults)) as pool:
        image, state = await pool.render(JOB, OPTIONS)
    assert sha256_of(image) == alone
    assert not faults.lost or (pool.dropped and sum(node["packets_resent"] for node in state["nodes"]))


@pytest.mark.usefixtures("all_help")
async def test_levels(room: Records) -> None:
    images = []
    for nodes in (1, 5):
        async with memory_pool(offline_world(), room, nodes) as pool:
            image, _ = await pool.render(JOB, replace(OPTIONS, samples=256, adaptive=Adaptive(0.15, 16)))
            images.append(sha256_of(image))
    assert images[0] == images[1]


@pytest.mark.usefixtures("all_help")
async def test_a_kept_film_goes_on_in_other_pools(room: Records, alone: str) -> None:
    for before, after in ((1, 3), (3, 2)):
        keep, film = await interrupted(room, replace(OPTIONS, pools=before), 3)
        image, state = await resumed(room, replace(OPTIONS, pools=after), 5, keep, film)
        assert sha256_of(image) == alone and state["paths_before"] > 0


async def test_nobody_gets_rays_from_another_pool_that_are_of_a_third_ones_pass(room: Records) -> None:
    async with memory_pool(offline_world(), room, 5) as pool:
        owner = await pool.start(JOB, OPTIONS)
        await pool.until(JOB, owner, "rendering")
        plan = PassPlan(JOB, PATHS)
        number = next(number for number in range(plan.count) if pass_owner(plan, number, 5) == 1)
        forged = SendRays(JOB, 0, 0, 90, 0, b"", (), (), (), (RayBatch(number, 0, 1),), bytes(RAY_BYTES))
        with pytest.raises(Refused, match="dealt by the owner"):
            await pool.deliver(f"node:{pool.nodes[4]}", pool.nodes[0], forged)
        # The link between the two has counted that, and is of no use any more.
        await pool.ask(owner, CancelJob(job=JOB))


# Losing nodes ------------------------------------------------------------------------------------------------


async def after_losing(pool: MemoryPool, victims: Sequence[NodeId], options: RenderOptions) -> tuple[str, dict[str, Any]]:
    """The image, some nodes having died once three passes were closed."""
    owner = await pool.start(JOB, options)
    while (await pool.state(JOB, owner))["closed"] < 3:
        await pool.world.clock.sleep(0.005)
    for victim in victims:
        pool.kill(victim)
    image, state = await pool.finished(JOB, owner)
    return sha256_of(image), state


async def after_a_comeback(
    pool: MemoryPool, options: RenderOptions, monkeypatch: pytest.MonkeyPatch
) -> tuple[bytes, dict[str, Any], NodeId]:
    """The image, a node having died once three passes were closed, and been started anew; and which one that was."""
    monkeypatch.setattr(organiser, "COMEBACK_WORTH", 0.0)
    monkeypatch.setattr(organiser, "COMEBACK_S", 0.05)
    monkeypatch.setattr(comebacks, "LOOK_S", 0.05)
    victim = next(node for node in pool.nodes if node != organiser_of(JOB, pool.nodes))
    owner = await pool.start(JOB, options)
    while (await pool.state(JOB, owner))["closed"] < 3:
        await pool.world.clock.sleep(0.005)
    pool.kill(victim)
    while not (await pool.state(JOB, owner))["lost"]:
        await pool.world.clock.sleep(0.005)
    await pool.restart(victim)
    return *(await pool.finished(JOB, owner)), victim


@pytest.mark.expect_log("nodes go on")
async def test_a_pool_carves_up_the_cell_of_a_node_that_dies(room: Records, alone: str) -> None:
    async with memory_pool(offline_world(), room, 5) as pool:
        victim = next(node for node in pool.nodes[:3] if node != organiser_of(JOB, pool.nodes))
        image, state = await after_losing(pool, [victim], OPTIONS)
    assert image == alone and state["pools"] == 2
    assert state["lost"] == [address_of(victim)] and state["attempts"] == 2


@pytest.mark.expect_log("nodes go on")
async def test_a_pool_that_dies_leaves_its_paths_to_the_others(room: Records, alone: str) -> None:
    async with memory_pool(offline_world(), room, 5) as pool:
        owner = organiser_of(JOB, pool.nodes)
        victims = pool.nodes[3:] if owner in pool.nodes[:3] else pool.nodes[:3]
        image, state = await after_losing(pool, victims, OPTIONS)
    assert image == alone and state["pools"] == 1


@pytest.mark.usefixtures("heavy")
@pytest.mark.expect_log("nodes go on")
async def test_pools_that_do_not_hold_the_scene_any_more_are_formed_anew(room: Records, alone: str) -> None:
    """Of four nodes each; what is left of one, a single node, has no room for all of the scene beside what it had."""
    async with memory_pool(offline_world(), room, 8) as pool:
        most = 13 * await largest(room, 1) // 10
        owner = organiser_of(JOB, pool.nodes)
        victims = [node for node in pool.nodes[4:] if node != owner][:3]
        for host in pool.hosts.values():
            host.service.promises.most = 2 * IMAGE + most
        assert 2 * await largest(room, 2) < most
        image, _ = await after_losing(pool, victims, replace(OPTIONS, moving=False))
        organising = pool.hosts[owner].service._organisers.get(JOB)
        assert organising is not None and organising._attempts is not None
        sizes = [len(places) for places in organising._attempts.division.ranges]
    assert image == alone
    assert sizes == [3, 2], "and not four and one"


@pytest.mark.usefixtures("heavy")
@pytest.mark.expect_log("nodes go on")
async def test_a_node_that_would_have_to_hold_all_of_it_beside_its_cell_is_no_pool_of_its_own(room: Records, alone: str) -> None:
    async with memory_pool(offline_world(), room, 4) as pool:
        for host in pool.hosts.values():
            host.service.promises.most = 2 * IMAGE + 13 * await largest(room, 1) // 10
        victim = next(node for node in pool.nodes if node != organiser_of(JOB, pool.nodes))
        image, state = await after_losing(pool, [victim], replace(OPTIONS, moving=False))
    assert image == alone and state["pools"] == 1


@pytest.mark.usefixtures("heavy")
async def test_what_another_pool_holds_says_nothing_of_this_one(room: Records) -> None:
    """Two nodes that are left of two pools have the same one cell, and only one of them held it before."""
    whole = await largest(room, 1)
    roomy, tight = IMAGE + 3 * whole, IMAGE + 13 * whole // 10
    nodes = [NodeId(number) for number in range(1, 5)]
    for algorithm in ("kd", "bounded-radial"):
        dividing = await dividing_of(
            room, replace(OPTIONS, algorithm=algorithm), dict(zip(nodes, [roomy, tight, tight, tight], strict=True))
        )
        first = dividing.first(nodes)
        one = first.without({1}, 2)
        assert await dividing.can_be(Standing(one, [nodes[0], *nodes[2:]]), Standing(first, nodes))
        both = one.without({2}, 3)
        assert not await dividing.can_be(Standing(both, [nodes[0], nodes[2]]), Standing(one, [nodes[0], *nodes[2:]]))
        # Who stands where it stood needs nothing.
        assert await dividing.can_be(Standing(one.with_epoch(7), [nodes[0], *nodes[2:]]), Standing(one, [nodes[0], *nodes[2:]]))


async def largest(room: Records, size: int) -> int:
    """Bytes of the largest cell of a pool of so many."""
    dividing = await dividing_of(room, OPTIONS, {})
    return max(dividing._bytes_of(dividing._cells(size, 5)))


async def dividing_of(room: Records, options: RenderOptions, free: dict[NodeId, int]) -> Dividing:
    tables = await read_tables(MemoryReader(room), offline_world().workers)
    camera = tables.camera(None)
    assert camera is not None
    return Dividing(offline_world().workers, tables, options, camera, free, 5)


@pytest.mark.expect_log("go on")
async def test_who_comes_back_is_in_a_pool_again(room: Records, alone: str, monkeypatch: pytest.MonkeyPatch) -> None:
    options = replace(OPTIONS, samples=640)
    async with memory_pool(offline_world(), room, 5) as pool:
        image, state, victim = await after_a_comeback(pool, options, monkeypatch)
        one, _ = await pool.render(JOB + 1, replace(options, pools=1))
    assert image == one
    assert state["back"] == [address_of(victim)] and state["pools"] == 2


# Forming -----------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("heavy")
@pytest.mark.parametrize(("cells_of", "pools"), [(1, 8), (4, 2), (8, 1)])
async def test_there_are_as_many_pools_as_memory_allows(room: Records, alone: str, cells_of: int, pools: int) -> None:
    """Each node may hold the image, twice as its organiser, and what a node of a pool of so many holds, twice among several."""
    async with memory_pool(offline_world(), room, 8) as pool:
        memory = 2 * IMAGE + (1 if cells_of == 1 else 2) * await largest(room, cells_of)
        for host in pool.hosts.values():
            host.service.promises.most = memory
        image, state = await pool.render(JOB, replace(OPTIONS, pools=POOLS_THAT_FIT, moving=False))
    assert sha256_of(image) == alone and state["pools"] == pools


@pytest.mark.parametrize("answer", [None, {}, {"memory": -1}, {"memory": 1.5}, [1]])
async def test_who_does_not_say_what_memory_it_has_is_no_node_to_render_with(answer: object) -> None:
    with pytest.raises(PeerFault):
        budget_told(JobStateReply(job=0, document=pack_value(answer)), "here")  # type: ignore[arg-type]
    with pytest.raises(PeerFault):
        budget_told(JobAnswer(job=0, reason=0, text=""), "here")
    assert budget_told(JobStateReply(job=0, document=pack_value(budget_document(-5))), "here") == 0


@pytest.mark.expect_log("in one pool")
async def test_with_a_node_of_an_older_version_there_is_one_pool(room: Records, alone: str) -> None:
    async with memory_pool(offline_world(), room, 3) as pool:
        older_node(pool)
        image, state = await pool.render(JOB, replace(OPTIONS, pools=POOLS_THAT_FIT))
    assert sha256_of(image) == alone and state["pools"] == 1


async def test_who_asks_for_more_pools_hears_which_node_is_of_an_older_version(room: Records) -> None:
    async with memory_pool(offline_world(), room, 3) as pool:
        older = older_node(pool)
        owner = await pool.start(JOB, OPTIONS)
        state = await pool.until(JOB, owner, "done", "failed")
    assert state["phase"] == "failed" and "older version" in state["failure"] and address_of(older) in state["failure"]


def older_node(pool: MemoryPool) -> NodeId:
    """One that does not say what memory it has."""
    deliver = pool.deliver
    older = next(node for node in pool.nodes if node != organiser_of(JOB, pool.nodes))

    async def refusing(peer: str, node: NodeId, packet: Packet) -> Packet | None:
        if node == older and isinstance(packet, JobState) and not packet.job:
            raise Refused(RejectReason.NOT_READY, "this node takes no part in that job")
        return await deliver(peer, node, packet)

    pool.deliver = refusing  # type: ignore[method-assign]
    return older


async def test_with_a_renderer_that_cannot_deal_paths_there_is_one_pool(room: Records, alone: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(EmbreeRenderer, "deals_paths", False)
    async with memory_pool(offline_world(), room, 3) as pool:
        image, state = await pool.render(JOB, replace(OPTIONS, pools=POOLS_THAT_FIT))
    assert sha256_of(image) == alone and state["pools"] == 1


@pytest.mark.usefixtures("heavy")
@pytest.mark.parametrize(("pools", "reason"), [(POOLS_THAT_FIT, RejectReason.NOT_READY), (5, RejectReason.BUSY)])
async def test_memory_that_was_counted_on_and_is_taken_by_then(room: Records, alone: str, pools: int, reason: RejectReason) -> None:
    """Who wants as many pools as can be is told to begin anew, and then there are fewer."""
    async with memory_pool(offline_world(), room, 5) as pool:
        owner, scene = organiser_of(JOB, pool.nodes), await largest(room, 1)
        victim = next(node for node in pool.nodes if node != owner)
        for host in pool.hosts.values():
            host.service.promises.most = 2 * IMAGE + scene + scene // 2
        others = pool.hosts[victim].service.promises.account()
        deliver = pool.deliver

        async def late(peer: str, node: NodeId, packet: Packet) -> Packet | None:
            if node == victim and isinstance(packet, StartJob) and not others.held:
                others.take("another render", scene, "another render", "wait")
            return await deliver(peer, node, packet)

        pool.deliver = late  # type: ignore[method-assign]
        await pool.start(JOB, replace(OPTIONS, pools=pools))
        state = await pool.until(JOB, owner, "done", "failed")
        assert state["phase"] == "failed" and state["failure_reason"] == reason and "other renders have" in state["failure"]
        if pools == POOLS_THAT_FIT:
            image, state = await pool.render(JOB + 1, replace(OPTIONS, pools=pools, moving=False))
            assert sha256_of(image) == alone and 1 <= state["pools"] < 5


async def test_only_nodes_are_told_what_memory_a_node_has(room: Records) -> None:
    async with memory_pool(offline_world(), room, 2) as pool:
        reply = await pool.deliver(f"node:{pool.nodes[1]}", pool.nodes[0], JobState(job=0))
        assert budget_told(reply, "here") == MemoryHost.memory_bytes
        assert "memory" not in unpack_value((await pool.ask(pool.nodes[0], JobState(job=0))).document, what="a state")


async def test_pools_that_do_not_hold_the_scene_say_what_to_do(room: Records, monkeypatch: pytest.MonkeyPatch) -> None:
    async with memory_pool(offline_world(), room, 2) as pool:
        monkeypatch.setattr("scenefold.render.pool.share.TRIANGLE_BYTES", MemoryHost.memory_bytes)
        owner = await pool.start(JOB, OPTIONS)
        state = await pool.until(JOB, owner, "done", "failed")
    assert state["phase"] == "failed" and "fewer pools" in state["failure"]


async def test_a_division_of_other_pools_is_refused_while_they_trace(room: Records) -> None:
    async with memory_pool(offline_world(), room, 3) as pool:
        owner = await pool.start(JOB, replace(OPTIONS, moving=False))
        await pool.until(JOB, owner, "rendering")
        part = pool.hosts[pool.nodes[0]].service._part(JOB)
        cells = [Partition.voronoi([[float(cell), 0.0, 0.0] for cell in range(size)]) for size in (1, 2, 3)]
        for pools in ((cells[0], cells[1]), (cells[2],)):
            with pytest.raises(PeerFault, match="from one pool to another"):
                await part.fetch(Division.of(pools, 9).to_document())
        with pytest.raises(PeerFault, match="another number of nodes"):
            await part.fetch(Division((cells[1],)).with_epoch(9).to_document())
        await pool.ask(owner, CancelJob(job=JOB))
