"""If this fails, an adaptive image depends on who made it, is wrong, or costs more than it saves."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from scenefold.render.job import RenderOptions
from scenefold.render.layers import unpacked
from scenefold.render.levels import Adaptive
from scenefold.render.rehearsal.pool import Records, memory_pool
from scenefold.world.real.world import offline_world

OPTIONS = RenderOptions(
    width=48, height=36, samples=256, seed=3, sky=(0.2, 0.3, 0.5), layers=("samples", "variance"), adaptive=Adaptive(0.1)
)
PLAIN = replace(OPTIONS, adaptive=None)
Layers = dict[str, np.ndarray[Any, Any]]


async def rendered(records: Records, options: RenderOptions, nodes: int = 1, threads: int = 1) -> tuple[Layers, dict[str, Any]]:
    async with memory_pool(offline_world(), records, nodes) as pool:
        for host in pool.hosts.values():
            host.render_threads = threads
        image, state = await pool.render(11 * nodes + threads, options)
    return unpacked(image, options.layers, options.width, options.height), state


def relative_error(layers: Layers, reference: Layers) -> float:
    """Mean over pixels of the squared error over the squared brightness; dark pixels count as a tenth of the mean."""
    error = ((layers["beauty"] - reference["beauty"]) ** 2).sum(axis=-1)
    light = np.maximum((reference["beauty"] ** 2).sum(axis=-1), 3 * (0.1 * reference["beauty"].mean()) ** 2)
    return float((error / light).mean())


async def test_any_number_of_nodes_and_threads_give_the_same_bits(room: Records) -> None:
    alone, state = await rendered(room, OPTIONS)
    assert state["paths"] == alone["samples"].sum() < 48 * 36 * 256
    for nodes, threads in ((1, 2), (2, 1), (3, 2)):
        together, other = await rendered(room, OPTIONS, nodes, threads)
        assert all((alone[name] == together[name]).all() for name in alone), f"{nodes} nodes, {threads} threads"
        assert other["paths"] == state["paths"] and other["passes"] == other["closed"] == state["passes"]


async def test_a_pixel_is_what_it_is_in_a_plain_image_of_as_many_samples(room: Records) -> None:
    adaptive, _ = await rendered(room, OPTIONS)
    counts = np.unique(adaptive["samples"]).tolist()
    assert set(counts) <= {16, 32, 64, 128, 256} and len(counts) > 2
    for count in counts:
        plain, _ = await rendered(room, replace(PLAIN, samples=count))
        here = adaptive["samples"] == count
        assert (adaptive["beauty"][here] == plain["beauty"][here]).all()
        assert (adaptive["variance"][here] == plain["variance"][here]).all()


async def test_fewer_paths_for_less_error_and_the_mean_is_right(room: Records) -> None:
    reference, _ = await rendered(room, replace(PLAIN, samples=4096, seed=77))
    adaptive, state = await rendered(room, OPTIONS)
    evenly = -(-state["paths"] // (48 * 36))
    plain, as_many = await rendered(room, replace(PLAIN, samples=evenly))
    assert as_many["paths"] >= state["paths"]
    assert relative_error(adaptive, reference) < 0.8 * relative_error(plain, reference)
    expected = np.sqrt(adaptive["variance"].sum() + reference["variance"].sum()) / adaptive["beauty"].size
    assert abs(float(adaptive["beauty"].mean(dtype=np.float64) - reference["beauty"].mean(dtype=np.float64))) < 3 * expected


async def test_it_ends_when_no_pixel_goes_on(room: Records) -> None:
    easy, state = await rendered(room, replace(OPTIONS, adaptive=Adaptive(1.0, 32)), nodes=2)
    assert (easy["samples"] == 32).mean() > 0.9
    assert state["phase"] == "done" and state["passes"] == state["closed"]
