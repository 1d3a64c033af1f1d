"""Equal bits, whoever held what: what a renderer must keep to render one image on many nodes (specs/07-rays.md, 09-renderer-contract.md)."""

from __future__ import annotations

import resource
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from scenefold.partition import Partition
from scenefold.render.arrays import F64
from scenefold.render.contract import Renderer, RoutingTracer, SkippingTracer, deals_paths
from scenefold.render.image_files import image_sha256
from scenefold.render.kit.expecting import expect, expect_nothing_lost
from scenefold.render.kit.furnace import inside_of_a_glowing_sphere
from scenefold.render.kit.rig import Flight, Rendered, Rig
from scenefold.render.kit.shapes import ball, looking, room, scene
from scenefold.render.numbers import job_numbers
from scenefold.render.pass_sums import PassSums
from scenefold.render.sum_columns import RADIANCE_UNIT
from scenefold.scene.payloads.materials import Material
from scenefold.scene.payloads.punctual import PunctualLight

SKY = (0.1, 0.15, 0.3)
GROUP_TRIANGLES = 12
"""So that nodes of a small room hold different groups."""
SCALED_ERROR_MAX = 0.02
"""Of the mean radiance: rounding sends a few paths past the other side of an edge."""
GROWTH_BYTES_MAX = 32 << 20
_PASSES = 24


def _room(renderer: Renderer, scale: float = 1.0) -> Rig:
    return Rig(room(scale), renderer, GROUP_TRIANGLES)


def expect_same(left: Rendered, right: Rendered, what: str) -> None:
    """Every path's radiance and features, and the image."""
    paths = int((left.radiance != right.radiance).any(axis=1).sum())
    expect(paths == 0, f"{what}: {paths} of {len(left.radiance)} paths have another radiance")
    features = int((left.aovs != right.aovs).any(axis=1).sum())
    expect(features == 0, f"{what}: {features} of {len(left.aovs)} paths have other features of their first hit")
    expect(image_sha256(left.beauty) == image_sha256(right.beauty), f"{what}: another image")


def any_number_of_nodes(renderer: Renderer) -> None:
    """1, 2, 5 and 16 nodes, cells of both families."""
    rig = _room(renderer)
    alone = rig.render(nodes=1, sky=SKY)
    expect_nothing_lost(alone, "one node")
    expect(0.1 < alone.beauty.mean() < 1.0, f"one node: the room's mean is {alone.beauty.mean()}, expected 0.1 to 1")
    for algorithm in ("voronoi", "bounded-radial"):
        for nodes in (2, 5, 16):
            together = rig.render(algorithm, nodes, sky=SKY)
            expect_same(together, alone, f"{nodes} nodes, {algorithm}")
            expect(together.passed > 0, f"{nodes} nodes, {algorithm}: no ray left its cell")


def any_cells(renderer: Renderer) -> None:
    """Hulls through the middle of the room, along its walls, and a hair beside; cells that are empty."""
    rig = _room(renderer)
    alone = rig.render(nodes=1, sky=SKY)
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float) * 0.5
    flat = np.array([[0.0, 0.5, 0.0], [0.0, 1.5, 0.0], [0.0, -1.5, 0.0]])
    empty = np.array([[0, 0, 0], [0, 0, 0], [1e-9, 0, 0], [50.0, 0, 0], [0, 0.5, 0]])
    for name, centroids in (("eight cells", corners), ("eight cells, moved", corners + 1e-7), ("walls", flat), ("empty cells", empty)):
        partition = Partition.voronoi(centroids)
        expect_same(rig.render(nodes=partition.nodes, partition=partition, sky=SKY), alone, name)


def any_moves(renderer: Renderer) -> None:
    """Cells of all families that move while rays fly, if the renderer's tracers can address rays anew."""
    rig = _room(renderer)
    job = rig.job("voronoi", 5, sky=SKY)
    with rig.opened(job) as scenes:
        if not isinstance(scenes[0].tracers(1)[0], RoutingTracer):
            expect(not deals_paths(renderer), "a renderer that deals paths (`deals_paths`) has tracers that cannot `route`")
            return
    cells = [rig.job(name, 5).partition for name in ("power", "bounded-radial", "kd", "planar", "voronoi")]
    moved, whole = rig.run_moving(job, cells), rig.run(job)
    paths = int((moved != whole.radiance).any(axis=1).sum())
    expect(paths == 0, f"cells that move: {paths} of {len(moved)} paths have another radiance")


def any_empty_space(renderer: Renderer) -> None:
    """Rays that are passed over cells in which they meet nothing, if the renderer's tracers can do that: fewer are passed on, to the same end."""
    rig = _room(renderer)
    alone = rig.render(nodes=1, sky=SKY)
    for algorithm in ("voronoi", "bounded-radial", "kd"):
        job = rig.job(algorithm, 8, sky=SKY)
        with rig.opened(job) as scenes:
            if not isinstance(scenes[0].tracers(1)[0], SkippingTracer):
                return
        passed, skipped = rig.run(job), rig.run(job, skips=True)
        expect_same(skipped, alone, f"8 nodes, {algorithm}, empty cells skipped")
        expect(
            skipped.passed < passed.passed,
            f"8 nodes, {algorithm}: {skipped.passed} rays are passed on, and {passed.passed} if none is skipped",
        )


def any_batches(renderer: Renderer) -> None:
    """Batches that are mixed and cut."""
    rig = _room(renderer)
    job = rig.job("voronoi", 3, sky=SKY, samples=1)
    whole = rig.run(job)
    for piece in (1, 7, 1000):
        expect_same(rig.run(job, np.random.default_rng(piece), piece), whole, f"batches of {piece}")


def any_size(renderer: Renderer) -> None:
    """Rooms from a hundredth of a millimetre to a hundred kilometres: the same bits on any nodes, and as bright as the room itself."""
    usual = _mean_radiance(_room(renderer).render(nodes=1, sky=SKY))
    for scale in (1e-5, 1e5):
        rig, what = _room(renderer, scale), f"a room {scale:g} times as large"
        alone = rig.render(nodes=1, sky=SKY)
        expect_same(rig.render("voronoi", 5, sky=SKY), alone, what)
        # Its lamps' intensities grow with the square, so that every radiance stays as it is.
        mean = _mean_radiance(alone)
        near = np.abs(mean - usual) <= SCALED_ERROR_MAX * usual
        expect(near.all(), f"{what}: the mean radiance is {mean}, expected {usual}, give or take {SCALED_ERROR_MAX:.0%}")


def _mean_radiance(image: Rendered) -> F64:
    """float64[3] of all paths."""
    mean: F64 = image.radiance.astype(np.float64).mean(axis=0) / RADIANCE_UNIT
    return mean


def any_threads(renderer: Renderer) -> None:
    """Four tracers at once, each with every fourth piece of a pass, into sums of their own."""
    rig = _room(renderer)
    job = rig.job("voronoi", 1, sky=SKY)
    alone, count = rig.run(job), job.plan.size(0)
    with rig.opened(job) as (opened,):
        tracers = opened.tracers(4)
        pieces = np.array_split(tracers[0].generate(0, count)[0], 64)
        sums = [PassSums.zeros(count, job.columns) for _ in tracers]

        def work(number: int) -> None:
            for rays in pieces[number :: len(tracers)]:
                outcome = tracers[number].advance(rays, 0, sums[number])
                expect(not outcome.leaving, "rays leave the only cell")

        with ThreadPoolExecutor(len(tracers)) as threads:
            list(threads.map(work, range(len(tracers))))
    total = sum(each.radiance for each in sums)
    expect(np.array_equal(total, alone.radiance), "four threads give another radiance than one")


def samples_go_on(renderer: Renderer) -> None:
    """More samples are those of before and others; another seed is another image."""
    rig = _room(renderer)
    few, many = rig.render(sky=SKY, samples=2), rig.render(sky=SKY, samples=4)
    expect(np.array_equal(few.radiance, many.radiance[: len(few.radiance)]), "the first samples depend on how many there are")
    expect(not np.array_equal(rig.render(sky=SKY, samples=2, seed=2).radiance, few.radiance), "the seed changes nothing")


def memory_stays(renderer: Renderer) -> None:
    """Pass after pass in one process; what a tracer keeps must be bounded by a batch."""
    rig = _room(renderer)
    job = rig.job("voronoi", 1, sky=SKY, width=128, height=128, samples=4 * _PASSES)
    with rig.opened(job) as (opened,):
        tracers = opened.tracers(1)
        before = 0
        for number in range(_PASSES):
            first, count = job.plan.first_path(number), job.plan.size(number)
            flight = Flight(tracers, first, count, job.columns)
            flight.land(tracers[0].generate(first, count))
            if number == _PASSES // 4:
                before = _resident_bytes()
        growth = _resident_bytes() - before
    expect(growth <= GROWTH_BYTES_MAX, f"memory grew by {growth >> 20} MiB over {_PASSES * 3 // 4} passes")


def _resident_bytes() -> int:
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize()


def cells_through_light_and_wall(renderer: Renderer) -> None:
    """The glowing sphere on three nodes, whose hulls cut through its wall and through all light."""
    inside_of_a_glowing_sphere(renderer, nodes=3)


def numbers_are_only_read(renderer: Renderer) -> None:
    """What a renderer is given stays as it was: others share it."""
    eye = looking((0, 0, 5), (0, 0, 0), yfov=0.5)
    lamp = PunctualLight(kind="point", position=(1.0, 2.0, 3.0), color=(5.0, 5.0, 5.0))
    rig = Rig(scene([[ball((0, 0, 0), 1.0, 8, 0, smooth=True)]], [Material()], [eye], punctual=[lamp]), renderer)
    job = rig.job("voronoi", 1, sky=SKY)
    numbers, held = job_numbers(job, rig.tables), rig.held(job.partition, 0)
    arrays = {name: value for name, value in (*held.arrays._asdict().items(), *numbers._asdict().items()) if isinstance(value, np.ndarray)}
    before = {name: value.tobytes() for name, value in arrays.items()}
    opened = renderer.open(held, numbers, job.partition, 0)
    try:
        tracers, count = opened.tracers(1), job.plan.size(0)
        rays = tracers[0].generate(0, count)
        copies = {node: batch.copy() for node, batch in rays.items()}
        Flight(tracers, 0, count, job.columns).land(rays)
    finally:
        opened.close()
    changed = [name for name, value in arrays.items() if value.tobytes() != before[name]]
    expect(not changed, f"the renderer wrote to {', '.join(changed)}")
    expect(all(np.array_equal(rays[node], copies[node]) for node in rays), "the renderer wrote to the rays that it was given")


BIT = {
    "any number of nodes": any_number_of_nodes,
    "any cells": any_cells,
    "any moves": any_moves,
    "any empty space": any_empty_space,
    "any batches": any_batches,
    "any size": any_size,
    "any threads": any_threads,
    "samples go on": samples_go_on,
    "memory stays": memory_stays,
    "cells through light and wall": cells_through_light_and_wall,
}
STATISTICAL = {"numbers are only read": numbers_are_only_read}
