"""If this fails, a node that dies while an image is traced ends the render, or changes the image (specs/31-attempts.md)."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import replace
from itertools import groupby
from typing import Any

import pytest
import trio

from scenefold.base.errors import LocalFault, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.render.algorithms import ALGORITHMS
from scenefold.render.job import RenderOptions
from scenefold.render.levels import Adaptive
from scenefold.render.pool import comebacks, organiser
from scenefold.render.pool.part import Part
from scenefold.render.pool.request import Keep, organiser_of
from scenefold.render.rehearsal.pool import MemoryPool, Records, memory_pool, sha256_of
from scenefold.wire import FilmPart, JobEvent, MergeFilm, Packet, unpack_value
from scenefold.world.real.world import offline_world

OPTIONS = RenderOptions(width=96, height=72, samples=160, seed=3, sky=(0.2, 0.3, 0.5), depth=4)
"""17 passes."""
JOB = 11
EACH_FAMILY = ("voronoi", "power", "planar", "radial")
"""With k-d boxes, which others here have."""
PER_NODE = 4
"""Passes of a node that are open, or not copied, at most: below 16 nodes."""

pytestmark = pytest.mark.expect_log("nodes go on|films are gathered again")


@pytest.fixture(autouse=True)
def looks_often(monkeypatch: pytest.MonkeyPatch) -> None:
    """These jobs are short."""
    monkeypatch.setattr(organiser, "POLL_S", 0.01)


@pytest.fixture(scope="module")
def alone(room: Records) -> Callable[[RenderOptions], str]:
    """Of what one node makes."""
    known: dict[RenderOptions, str] = {}

    async def render(options: RenderOptions) -> str:
        async with memory_pool(offline_world(), room, 1) as pool:
            image, _ = await pool.render(JOB, options)
        return sha256_of(image)

    def hash_of(options: RenderOptions) -> str:
        plain = replace(options, algorithm="voronoi", moving=False)
        if plain not in known:
            known[plain] = trio.run(render, plain)
        return known[plain]

    return hash_of


def nodes_of_rounds(state: dict[str, Any]) -> list[int]:
    """How many took part, each time that it changed. Of rounds that moves end there may be any number."""
    return [count for count, _ in groupby(count for _, _, count in state["rounds"])]


def others(pool: MemoryPool) -> list[NodeId]:
    """All nodes but the one that organises the job."""
    return [node for node in pool.nodes if node != organiser_of(JOB, pool.nodes)]


async def closed(pool: MemoryPool, owner: NodeId, least: int) -> dict[str, Any]:
    """Wait until so many passes are closed."""
    while True:
        state = await pool.state(JOB, owner)
        assert state["phase"] in ("preparing", "rendering"), state["failure"]
        if state["closed"] >= least:
            assert state["closed"] < OPTIONS.plan.count
            return state
        await pool.world.clock.sleep(0.005)


@pytest.fixture(scope="module", params=[3, 5])
def nodes(request: pytest.FixtureRequest) -> int:
    count: int = request.param
    return count


@pytest.mark.parametrize(
    "options",
    [replace(OPTIONS, moving=False), OPTIONS, pytest.param(replace(OPTIONS, algorithm="kd"), marks=pytest.mark.long)],
    ids=["fixed", "moving", "kd"],
)
async def test_the_image_is_the_same(room: Records, alone: Callable[[RenderOptions], str], options: RenderOptions, nodes: int) -> None:
    async with memory_pool(offline_world(), room, nodes) as pool:
        owner = await pool.start(JOB, options)
        await closed(pool, owner, 4)
        victim = others(pool)[0]
        pool.kill(victim)
        image, state = await pool.finished(JOB, owner)
    assert (state["attempts"], state["lost"]) == (2, [address_of(victim)])
    assert state["closed"] == state["passes"] == options.plan.count
    assert state["passes_again"] <= PER_NODE * nodes
    assert nodes_of_rounds(state) == [nodes, nodes - 1]
    assert sum(visits for visits, _, _ in state["rounds"]) == sum(node["casts"] for node in state["nodes"])
    assert sha256_of(image) == await trio.to_thread.run_sync(alone, options)


@pytest.mark.parametrize("algorithm", [pytest.param(name, marks=() if name in EACH_FAMILY else pytest.mark.long) for name in ALGORITHMS])
async def test_cells_of_all_kinds_close_up(room: Records, alone: Callable[[RenderOptions], str], algorithm: str) -> None:
    options = replace(OPTIONS, algorithm=algorithm)
    async with memory_pool(offline_world(), room, 4) as pool:
        owner = await pool.start(JOB, options)
        await closed(pool, owner, 3)
        pool.kill(others(pool)[1])
        image, state = await pool.finished(JOB, owner)
    assert state["attempts"] == 2
    assert sha256_of(image) == await trio.to_thread.run_sync(alone, options)


async def test_one_after_the_other_until_one_is_left(room: Records, alone: Callable[[RenderOptions], str]) -> None:
    async with memory_pool(offline_world(), room, 4) as pool:
        owner = await pool.start(JOB, OPTIONS)
        for least, victim in zip((2, 6, 10), others(pool), strict=True):
            await closed(pool, owner, least)
            pool.kill(victim)
        image, state = await pool.finished(JOB, owner)
    assert state["attempts"] == 4 and state["lost"] == [address_of(node) for node in others(pool)]
    assert sha256_of(image) == await trio.to_thread.run_sync(alone, OPTIONS)


async def test_a_node_that_was_started_anew_knows_nothing_of_the_job_and_is_lost(
    room: Records, alone: Callable[[RenderOptions], str]
) -> None:
    async with memory_pool(offline_world(), room, 3) as pool:
        owner = await pool.start(JOB, OPTIONS)
        await closed(pool, owner, 3)
        victim = others(pool)[1]
        pool.kill(victim)
        await pool.restart(victim)
        image, state = await pool.finished(JOB, owner)
        assert state["lost"] == [address_of(victim)]
        # It may take part in others.
        again, _ = await pool.render(JOB + 1, replace(OPTIONS, samples=4))
        assert again
    assert sha256_of(image) == await trio.to_thread.run_sync(alone, OPTIONS)


@pytest.fixture
def comes_soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """Who is back is seen soon, and joins whatever that costs."""
    monkeypatch.setattr(comebacks, "LOOK_S", 0.02)
    monkeypatch.setattr(organiser, "COMEBACK_S", 0.05)
    monkeypatch.setattr(organiser, "COMEBACK_WORTH", 0.0)


@pytest.mark.usefixtures("comes_soon")
@pytest.mark.parametrize("was_started_anew", [True, pytest.param(False, marks=pytest.mark.long)], ids=["started anew", "cut off"])
async def test_a_node_that_comes_back_takes_part_again(
    room: Records, alone: Callable[[RenderOptions], str], was_started_anew: bool
) -> None:
    """One that was only cut off has passes in its film that others have by now: it begins with nothing."""
    options = replace(OPTIONS, samples=640)
    async with memory_pool(offline_world(), room, 4) as pool:
        owner = await pool.start(JOB, options)
        await closed(pool, owner, 4)
        victim = others(pool)[1]
        if was_started_anew:
            pool.kill(victim)
        pool.hosts[victim].away = True
        while not (await pool.state(JOB, owner))["lost"]:
            await pool.world.clock.sleep(0.01)
        if was_started_anew:
            await pool.restart(victim)
        pool.hosts[victim].away = False
        image, state = await pool.finished(JOB, owner)
        (told,) = [node for node in state["nodes"] if node["address"] == address_of(victim)]
    assert state["back"] == state["lost"] == [address_of(victim)] and state["attempts"] == 3
    assert told["casts"] > 0 and told["attempt"] == 2
    assert nodes_of_rounds(state) == [4, 3, 4]
    assert sum(visits for visits, _, _ in state["rounds"]) == sum(node["casts"] for node in state["nodes"]), "also what it did before"
    assert sha256_of(image) == await trio.to_thread.run_sync(alone, options)


@pytest.mark.usefixtures("comes_soon")
@pytest.mark.expect_log("are back")
@pytest.mark.long
async def test_nodes_die_and_come_back_all_the_time(room: Records, alone: Callable[[RenderOptions], str]) -> None:
    options = replace(OPTIONS, samples=640)
    async with memory_pool(offline_world(), room, 4) as pool:
        owner = await pool.start(JOB, options)
        for turn, victim in enumerate((*others(pool), *others(pool)[:2])):
            while (state := await pool.state(JOB, owner))["closed"] < 4 + 6 * turn or len(state["back"]) < turn:
                assert state["phase"] in ("preparing", "rendering")
                await pool.world.clock.sleep(0.01)
            pool.kill(victim)
            await pool.restart(victim)
        image, state = await pool.finished(JOB, owner)
    assert len(state["lost"]) == 5 and len(state["back"]) >= 4
    assert sha256_of(image) == await trio.to_thread.run_sync(alone, options)


async def test_what_a_node_says_that_is_thought_lost_is_refused_and_counted(room: Records, alone: Callable[[RenderOptions], str]) -> None:
    """Nobody reaches it, and it goes on: rays, counts and sums of its own come to the others until the end."""
    async with memory_pool(offline_world(), room, 3) as pool:
        owner = await pool.start(JOB, OPTIONS)
        await closed(pool, owner, 3)
        victim = others(pool)[0]
        pool.hosts[victim].away = True
        image, state = await pool.finished(JOB, owner)
    assert any("of another attempt" in str(error) for error in pool.complaints)
    assert sum(node["late"] for node in state["nodes"]) > 0
    assert sha256_of(image) == await trio.to_thread.run_sync(alone, OPTIONS)


class _Interrupting(MemoryPool):
    """Somebody dies when a packet of some kind is on its way for the first time."""

    when: Callable[[Packet], bool]
    victim: NodeId | None = None

    async def deliver(self, peer: str, node: NodeId, packet: Packet) -> Packet | None:
        if self.victim is not None and self.when(packet):
            victim, self.victim = self.victim, None
            self.kill(victim)
            # Handlers and tasks of its process end with it.
            await trio.lowlevel.checkpoint()
        return await super().deliver(peer, node, packet)


@asynccontextmanager
async def interrupted(
    records: Records, count: int, when: Callable[[Packet], bool], monkeypatch: pytest.MonkeyPatch
) -> AsyncIterator[_Interrupting]:
    monkeypatch.setattr("scenefold.render.rehearsal.pool.MemoryPool", _Interrupting)
    monkeypatch.setattr(_Interrupting, "when", staticmethod(when), raising=False)
    async with memory_pool(offline_world(), records, count) as pool:
        assert isinstance(pool, _Interrupting)
        yield pool


def says(word: str) -> Callable[[Packet], bool]:
    """An event with this entry."""

    def when(packet: Packet) -> bool:
        document = unpack_value(packet.document, what="an event") if isinstance(packet, JobEvent) else None
        return isinstance(document, dict) and word in document

    return when


STEPS: dict[str, Callable[[Packet], bool]] = {
    **{word: says(word) for word in ("hold", "fetch", "begin", "gathered", "until")},
    "merge": lambda packet: isinstance(packet, MergeFilm),
    "film": lambda packet: isinstance(packet, FilmPart),
}


@pytest.mark.parametrize("step", [pytest.param(step, marks=() if step in ("fetch", "merge") else pytest.mark.long) for step in STEPS])
async def test_another_node_dies_while_the_others_begin_again(
    room: Records, alone: Callable[[RenderOptions], str], step: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    options = replace(OPTIONS, moving=False)
    async with interrupted(room, 4, STEPS[step], monkeypatch) as pool:
        owner = await pool.start(JOB, options)
        await closed(pool, owner, 5)
        first, pool.victim, _ = others(pool)
        pool.kill(first)
        image, state = await pool.finished(JOB, owner)
    assert len(state["lost"]) == 2
    assert sha256_of(image) == await trio.to_thread.run_sync(alone, options)


async def test_another_node_dies_while_it_makes_its_film_ready(
    room: Records, alone: Callable[[RenderOptions], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was told of the next attempt, and never answers."""
    pause = Part.pause

    async def dies(self: Part, document: dict[str, Any], organiser: NodeId) -> None:
        if self.me == pool.nodes.index(victim):
            pool.kill(victim)
            await trio.sleep_forever()
        await pause(self, document, organiser)

    monkeypatch.setattr(Part, "pause", dies)
    async with memory_pool(offline_world(), room, 4) as pool:
        owner = await pool.start(JOB, OPTIONS)
        await closed(pool, owner, 5)
        first, victim, _ = others(pool)
        pool.kill(first)
        image, state = await pool.finished(JOB, owner)
    assert state["lost"] == [address_of(first), address_of(victim)]
    assert sha256_of(image) == await trio.to_thread.run_sync(alone, OPTIONS)


@pytest.mark.parametrize("step", ["merge", "film", "gathered"])
async def test_a_node_dies_while_the_image_is_gathered(
    room: Records, alone: Callable[[RenderOptions], str], step: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with interrupted(room, 3, STEPS[step], monkeypatch) as pool:
        pool.victim = others(pool)[0]
        owner = await pool.start(JOB, OPTIONS)
        image, state = await pool.finished(JOB, owner)
    assert state["attempts"] == 2 and state["closed"] == state["passes"]
    assert sha256_of(image) == await trio.to_thread.run_sync(alone, OPTIONS)


class _Stumbling(MemoryPool):
    """Packets of some kind do not arrive a few times, though all live."""

    times = 3

    async def deliver(self, peer: str, node: NodeId, packet: Packet) -> Packet | None:
        if isinstance(packet, FilmPart) and self.times and node != organiser_of(JOB, self.nodes):
            self.times -= 1
            raise Unreachable("the connection broke", where=address_of(node))
        return await super().deliver(peer, node, packet)


async def test_films_that_did_not_come_are_gathered_again(
    room: Records, alone: Callable[[RenderOptions], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("scenefold.render.rehearsal.pool.MemoryPool", _Stumbling)
    monkeypatch.setattr("scenefold.render.pool.attempts.GATHER_PAUSE_S", 0.01)
    async with memory_pool(offline_world(), room, 4) as pool:
        assert isinstance(pool, _Stumbling)
        owner = await pool.start(JOB, OPTIONS)
        image, state = await pool.finished(JOB, owner)
        assert not pool.times
    assert (state["attempts"], state["lost"]) == (1, [])
    assert sha256_of(image) == await trio.to_thread.run_sync(alone, OPTIONS)


async def test_films_that_never_come_end_the_job_with_a_word(room: Records, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("scenefold.render.rehearsal.pool.MemoryPool", _Stumbling)
    monkeypatch.setattr(_Stumbling, "times", 1 << 30)
    monkeypatch.setattr("scenefold.render.pool.attempts.GATHER_PAUSE_S", 0.01)
    monkeypatch.setattr("scenefold.render.pool.attempts.GATHER_S_MAX", 0.1)
    async with memory_pool(offline_world(), room, 4) as pool:
        owner = await pool.start(JOB, OPTIONS)
        state = await pool.until(JOB, owner, "failed", "done")
    assert state["phase"] == "failed" and "the connection broke" in state["failure"]


async def test_levels_and_kept_films_go_on(room: Records, alone: Callable[[RenderOptions], str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Which pixels go on is told again; what is kept is of whole stages."""
    options = replace(OPTIONS, samples=512, adaptive=Adaptive(0.05, 32))
    async with memory_pool(offline_world(), room, 3) as pool:
        owner = await pool.start(JOB, options, keep=Keep())
        await closed(pool, owner, options.plan.passes_until(1) + 1)
        pool.kill(others(pool)[0])
        image, state = await pool.finished(JOB, owner)
    assert state["attempts"] == 2
    assert sha256_of(image) == await trio.to_thread.run_sync(alone, options)


async def test_who_cannot_hold_the_cell_of_the_dead_fails_the_job_with_a_word(room: Records, monkeypatch: pytest.MonkeyPatch) -> None:
    async def fetch(_self: object, *_args: object) -> object:
        raise LocalFault("no memory for more")

    monkeypatch.setattr("scenefold.render.pool.moving.Moving._moved", fetch)
    async with memory_pool(offline_world(), room, 3) as pool:
        owner = await pool.start(JOB, replace(OPTIONS, moving=False))
        await closed(pool, owner, 2)
        pool.kill(others(pool)[0])
        state = await pool.until(JOB, owner, "failed", "done")
    assert state["phase"] == "failed" and "no memory for more" in state["failure"]
