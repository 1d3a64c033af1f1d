"""If this fails, the arithmetic renderer's image is not the one in closed form, or what a pool might do wrong does not show in it."""

from __future__ import annotations

import numpy as np
import pytest

from scenefold.base.errors import LocalFault, PeerFault
from scenefold.render.arrays import U32
from scenefold.render.contract import MovableScene, RoutingTracer
from scenefold.render.job import RenderOptions
from scenefold.render.kit.rig import Flight, Rendered, Rig
from scenefold.render.layers import packed, unpacked
from scenefold.render.levels import Adaptive
from scenefold.render.pass_sums import PassSums
from scenefold.render.rehearsal.arithmetic import PATH, STEP, ArithmeticRenderer
from scenefold.render.rehearsal.arithmetic_image import image_of
from scenefold.render.rehearsal.lattice import SQUARES, lattice, places_of, squares_at
from scenefold.render.window import Window

ASKED = {"width": 11, "height": 9, "samples": 5, "seed": 3, "layers": ("albedo", "samples")}


@pytest.fixture(scope="module")
def rig() -> Rig:
    return Rig(lattice(), ArithmeticRenderer())


def bytes_of(rendered: Rendered) -> bytes:
    return packed({name: values for name, values in rendered.layers.items() if name in ("beauty", "albedo", "samples")})


def test_places_and_squares_are_the_same() -> None:
    squares = np.arange(SQUARES)
    assert (squares_at(places_of(squares)) == squares).all() and len(np.unique(places_of(squares), axis=0)) == SQUARES


@pytest.mark.parametrize("crop", [None, Window(2, 3, 5, 4)], ids=["all", "crop"])
@pytest.mark.parametrize("algorithm", ["bounded-radial", "kd", "power", "voronoi"])
@pytest.mark.parametrize("nodes", [1, 2, 5])
def test_any_number_of_nodes_makes_the_image_in_closed_form(rig: Rig, nodes: int, algorithm: str, crop: Window | None) -> None:
    rendered = rig.render(algorithm, nodes, **ASKED, crop=crop)
    assert bytes_of(rendered) == image_of(RenderOptions(**ASKED, algorithm=algorithm, crop=crop))  # type: ignore[arg-type]
    assert nodes == 1 or (rendered.passed and max(rendered.held) < 16)


def test_noisy_pixels_go_on_for_longer() -> None:
    """Each has the samples of one of the levels, and the light of just these."""
    asked = {**ASKED, "samples": 24}
    plain = {count: image_of(RenderOptions(**{**asked, "samples": count})) for count in (4, 8, 16, 24)}  # type: ignore[arg-type]
    ends = {noise: image_of(RenderOptions(**asked, adaptive=Adaptive(noise, 4))) for noise in (1e-6, 0.15, 1.0)}  # type: ignore[arg-type]
    assert ends[1e-6] == plain[24] and ends[1.0] == plain[4]
    shape = ASKED["layers"], ASKED["width"], ASKED["height"]
    some, of_counts = unpacked(ends[0.15], *shape), {count: unpacked(image, *shape) for count, image in plain.items()}  # type: ignore[arg-type]
    assert len(np.unique(some["samples"])) > 1
    for name in ("beauty", "albedo"):
        for count in np.unique(some["samples"]):
            mine = some["samples"] == count
            assert (some[name][mine] == of_counts[int(count)][name][mine]).all()


def test_another_seed_is_another_image() -> None:
    one, other = (image_of(RenderOptions(**{**ASKED, "seed": seed})) for seed in (3, 4))  # type: ignore[arg-type]
    assert one != other


def test_cells_may_move(rig: Rig) -> None:
    job = rig.job("kd", 3, **ASKED)
    cells = [job.partition, rig.job("planar", 3, **ASKED).partition.with_epoch(2), rig.job("voronoi", 3, **ASKED).partition.with_epoch(3)]
    still = rig.run(job)
    assert (rig.run_moving(job, cells) == still.radiance).all()
    with rig.opened(job) as scenes:
        assert all(isinstance(scene, MovableScene) and isinstance(scene.tracers(1)[0], RoutingTracer) for scene in scenes)


def first_rays(rig: Rig) -> tuple[Flight, U32]:
    """Of one node's job, not traced yet."""
    job = rig.job("kd", 1, **ASKED)
    with rig.opened(job) as (scene,):
        flight = Flight([scene.tracers(1)[0]], 0, job.plan.size(0), job.columns)
        return flight, scene.tracers(1)[0].generate(0, job.plan.size(0))[0]


def traced(rig: Rig, rays: U32, first_path: int = 0) -> PassSums:
    job = rig.job("kd", 1, **ASKED)
    sums = PassSums.zeros(job.plan.size(0), job.columns)
    with rig.opened(job) as (scene,):
        counts = scene.tracers(1)[0].advance(rays, first_path, sums)
    assert len(rays) + counts.created == counts.retired and not counts.leaving
    return sums


def test_a_ray_that_is_lost_or_doubled_shows(rig: Rig) -> None:
    _, rays = first_rays(rig)
    whole = traced(rig, rays)
    for wrong in (rays[1:], np.concatenate([rays, rays[:1]])):
        sums = traced(rig, wrong)
        assert (sums.radiance != whole.radiance).any() and (sums.aovs != whole.aovs).any()


def test_a_ray_that_was_changed_or_is_of_another_pass_is_not_taken(rig: Rig) -> None:
    _, rays = first_rays(rig)
    for word, more in ((STEP, 1), (PATH, 1 << 16), (0, 1), (3, 1)):
        changed = rays.copy()
        changed[4, word] += np.uint32(more)
        with pytest.raises(PeerFault):
            traced(rig, changed)
    with pytest.raises(PeerFault, match="not of the pass"):
        traced(rig, rays, first_path=7)


def test_a_ray_is_not_traced_in_another_cell(rig: Rig) -> None:
    job = rig.job("kd", 2, **ASKED)
    with rig.opened(job) as (one, other):
        rays = one.tracers(1)[0].generate(0, job.plan.size(0))
        with pytest.raises(AssertionError, match="outside of its node's cell"):
            other.tracers(1)[0].advance(rays[0], 0, PassSums.zeros(job.plan.size(0), job.columns))


def test_of_what_depends_on_what_was_found_there_is_no_closed_form() -> None:
    with pytest.raises(LocalFault):
        image_of(RenderOptions(layers=("variance",)))
