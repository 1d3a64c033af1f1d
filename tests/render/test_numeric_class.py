"""If this fails, nodes whose processors round differently make one image together, whose bits depend on who traced what; or equal ones refuse each other."""

from __future__ import annotations

import ctypes
import re
from pathlib import Path

import pytest

from scenefold.base.errors import LocalFault
from scenefold.base.ids import NodeId, address_of
from scenefold.base.reasons import RejectReason
from scenefold.render.job import RenderOptions
from scenefold.render.pool import service
from scenefold.render.pool.unattended import ALL_JOBS
from scenefold.render.rehearsal.pool import Records, memory_pool
from scenefold.render.renderers.embree import library, numeric_class
from scenefold.render.renderers.embree.library import Device
from scenefold.render.renderers.embree.numeric_class import processor_print
from scenefold.render.renderers.embree.renderer import EmbreeRenderer
from scenefold.render.reports import class_told
from scenefold.wire import JobState
from scenefold.world.real.world import offline_world

OPTIONS = RenderOptions(width=16, height=12, samples=4, sky=(0.2, 0.3, 0.5))


def print_of() -> str:
    device = Device()
    try:
        return processor_print(device)
    finally:
        device.release()


def test_the_class_is_the_same_whenever_it_is_asked_for() -> None:
    numeric_class.numeric_class.cache_clear()
    first = numeric_class.numeric_class()
    numeric_class.numeric_class.cache_clear()
    assert numeric_class.numeric_class() == first
    assert re.fullmatch(r"embree-4\.\d+\.\d+-avx2-embreex-[0-9.a-z]+-kernels-\d+-print-[0-9a-f]{8}", first)
    assert len(first) <= 80, "errors name it, and would cut its end off, which tells processors apart"


@pytest.mark.parametrize("other", ["sse2", "avx512"])
def test_the_print_tells_other_arithmetic_by_what_comes_out(monkeypatch: pytest.MonkeyPatch, other: str) -> None:
    """Another maker's processor is not to be had here; other instructions for the same reciprocals are. Their names are no part of the print."""
    if other == "avx512" and " avx512f " not in Path("/proc/cpuinfo").read_text():
        pytest.skip("this processor has no AVX-512")
    mine = print_of()
    monkeypatch.setattr(library, "ISA", other)
    assert print_of() != mine


@pytest.mark.parametrize("threads", [1, 2, 4])
def test_the_print_does_not_depend_on_how_trees_are_built(monkeypatch: pytest.MonkeyPatch, threads: int) -> None:
    mine = print_of()
    monkeypatch.setattr(library, "BUILD_THREADS", threads)
    assert print_of() == mine


def test_rays_for_the_print_meet_triangles_and_instances() -> None:
    """A print of misses would tell nothing."""
    seen = list[object]()

    class Watched(Device):
        def intersect(self, scene: int, ray_hit: int) -> None:
            super().intersect(scene, ray_hit)
            words = (ctypes.c_uint32 * 24).from_address(ray_hit)
            seen.append((words[18], words[19]))

    device = Watched()
    try:
        processor_print(device)
    finally:
        device.release()
    plain, within, missed = seen.count((0, 0xFFFFFFFF)), seen.count((0, 1)), seen.count((0xFFFFFFFF, 0xFFFFFFFF))
    assert plain + within + missed == len(seen)
    assert plain > 500 and within > 300, (plain, within, missed)


async def test_a_node_of_another_class_ends_the_job_and_says_its_class_to_whoever_asks(
    room: Records, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So that a client begins it anew, without that node."""
    loaded = list[EmbreeRenderer]()

    class Odd(EmbreeRenderer):
        def numeric_class(self) -> str:
            return "of another maker"

    def load(_name: str) -> EmbreeRenderer:
        loaded.append(Odd() if len(loaded) == 2 else EmbreeRenderer())
        return loaded[-1]

    monkeypatch.setattr(service, "load_renderer", load)
    async with memory_pool(offline_world(), room, 3) as pool:

        async def said() -> dict[NodeId, str]:
            replies = {node: await pool.ask(node, JobState(job=ALL_JOBS)) for node in pool.nodes}
            return {node: class_told(reply.document, address_of(node)) for node, reply in replies.items()}

        assert {*(await said()).values()} == {""}, "nobody has loaded a renderer yet, and nobody does for a question"
        state = await pool.until(5, await pool.start(5, OPTIONS), "failed")
        assert state["failure_reason"] == RejectReason.NOT_READY
        assert state["failure"].startswith("this node renders in another numeric class than the job, of another maker\n")
        classes = await said()
        (odd,) = (node for node, told in classes.items() if told == "of another maker")
        assert address_of(odd) in state["failure"]
        others = [node for node in pool.nodes if node != odd]
        assert {classes[node] for node in others} == {numeric_class.numeric_class()}
        _, state = await pool.render(6, OPTIONS, others)
        assert state["numeric_class"] == numeric_class.numeric_class()


async def test_a_node_that_cannot_render_tells_of_its_jobs_all_the_same(room: Records, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else nobody could list renders on any node, once this one was asked to take part in one."""

    class Lame(EmbreeRenderer):
        def numeric_class(self) -> str:
            raise LocalFault("this processor lacks AVX2", remedy="render on nodes with AVX2")

    monkeypatch.setattr(service, "load_renderer", lambda _: Lame())
    async with memory_pool(offline_world(), room, 1) as pool:
        (node,) = pool.nodes
        state = await pool.until(5, await pool.start(5, OPTIONS), "failed")
        assert "AVX2" in state["failure"]
        reply = await pool.ask(node, JobState(job=ALL_JOBS))
        assert class_told(reply.document, address_of(node)) == ""
