"""If this fails, lights are asked for with another density than paths are told, and images come out too bright or too dark."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest

from scenefold.render.arrays import JobNumbers, LightColumn, MaterialColumn, SceneArrays, TextureUseColumn
from scenefold.render.dice_kernels import SAMPLER_SOBOL
from scenefold.render.lanes_kernels import LANES
from scenefold.render.setup_kernels import emitter_power, linear_of_srgb
from unit.render import lanes_probe_kernels as lanes
from unit.render import probe_kernels as probe

Floats = npt.NDArray[np.float64]

CORNERS = np.array(
    [[[-1, 2, -1], [1, 2, -1], [0, 2, 1]], [[2, 0, -1], [2, 1, 0], [2, 0, 1]], [[-3, 0, 0], [-3, 1, 1], [-3, 2, 0]]], np.float32
)
RADIANCE = np.array([[3, 2, 1], [0.5, 4, 8], [1, 1, 1]], np.float32)
TWO_SIDED = np.array([0, 1, 1], np.uint8)
POINT, NORMAL = np.array([0.1, 0.2, -0.1]), np.array([0.0, 1.0, 0.0])
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def punctual_rows() -> Floats:
    rows = np.zeros((3, LightColumn.WIDTH))
    for row, kind, probability in zip(rows, (0, 1, 2), (0.5, 0.3, 0.2), strict=True):
        row[LightColumn.KIND], row[LightColumn.PROBABILITY] = kind, probability
        row[LightColumn.POSITION : LightColumn.POSITION + 3] = (0.5, 3.0, 0.0)
        row[LightColumn.DIRECTION : LightColumn.DIRECTION + 3] = (0.0, -1.0, 0.0)
        row[LightColumn.COLOR : LightColumn.COLOR + 3] = (1.0, 2.0, 4.0)
        row[LightColumn.COS_INNER], row[LightColumn.COS_OUTER] = math.cos(0.1), math.cos(0.5)
    return rows


def alias_table(weights: Floats) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.uint32]]:
    """Walker's, the plain way."""
    count = len(weights)
    scaled = list(weights / weights.sum() * count)
    threshold, alias = np.ones(count, np.float32), np.arange(count, dtype=np.uint32)
    small, large = [i for i in range(count) if scaled[i] < 1], [i for i in range(count) if scaled[i] >= 1]
    while small and large:
        low, high = small.pop(), large.pop()
        threshold[low], alias[low] = scaled[low], high
        scaled[high] -= 1 - scaled[low]
        (small if scaled[high] < 1 else large).append(high)
    return threshold, alias


def areas() -> Floats:
    crosses = np.cross(CORNERS[:, 1] - CORNERS[:, 0], CORNERS[:, 2] - CORNERS[:, 0]).astype(np.float64)
    found: Floats = np.linalg.norm(crosses, axis=1) / 2
    return found


def lit_scene() -> SceneArrays:
    threshold, alias = alias_table(areas() * (RADIANCE @ LUMINANCE))
    none = np.zeros((0, 3), np.float32)
    return SceneArrays(
        none,
        none,
        np.zeros((0, 2), np.float32),
        np.zeros((0, 3), np.uint32),
        np.zeros(0, np.uint16),
        np.zeros(0, np.int64),
        np.zeros((0, 3, 4)),
        np.zeros((0, 3, 3)),
        np.zeros((0, MaterialColumn.WIDTH), np.float32),
        np.zeros((0, 4), np.int64),
        np.zeros(0, np.uint8),
        linear_of_srgb(),
        CORNERS,
        RADIANCE,
        TWO_SIDED,
        threshold,
        alias,
        punctual_rows(),
        np.zeros((1, TextureUseColumn.WIDTH)),
        np.zeros((1, 2), np.float32),
        np.ones((1, 4), np.float32),
        np.zeros((1, 4), np.float32),
        has_uvs2=False,
        has_colors=False,
        has_tangents=False,
        environment=np.zeros((1, 1, 3), np.float32),
        environment_rows=np.array([0.0, 1.0], np.float32),
        environment_columns=np.array([[0.0, 1.0]], np.float32),
        emitter_uses=np.full(1, -1.0, np.float32),
        emitter_emissive=np.zeros((1, 3), np.float32),
        emitter_uvs=np.zeros((1, 3, 2), np.float32),
        has_emitter_maps=False,
        emitter_reach=np.abs(CORNERS[:, 1:] - CORNERS[:, :1]).max(axis=(1, 2)),
    )


def job(sky: float, punctual: float, emitter: float) -> JobNumbers:
    power = float(emitter_power(CORNERS, RADIANCE))
    low, high = np.array([-4.0, -1.0, -4.0]), np.array([4.0, 4.0, 4.0])
    return JobNumbers(
        low,
        high,
        np.array([1.0, 2.0, 3.0]),
        sky,
        punctual,
        emitter,
        1 / power,
        np.zeros(16),
        1,
        0,
        8,
        8,
        1,
        8,
        5,
        7,
        9,
        SAMPLER_SOBOL,
        0,
        0,
        8,
        8,
        3,
        math.inf,
        math.inf,
        False,
        1.0,
        0.0,
    )


def samples(numbers: JobNumbers, count: int = 200_000) -> Floats:
    return lanes.lights(lit_scene(), numbers, POINT, np.arange(-(-count // LANES) * LANES, dtype=np.uint32), NORMAL)[:count]


def test_power_is_luminance_times_area() -> None:
    assert emitter_power(CORNERS, RADIANCE) == pytest.approx(float((areas() * (RADIANCE @ LUMINANCE)).sum()), rel=1e-6)


@pytest.mark.parametrize("shares", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.25, 0.25, 0.5)])
def test_samples_are_whole(shares: tuple[float, float, float]) -> None:
    found = samples(job(*shares), 20_000)
    hit = found[found[:, 0] == 1]
    assert len(hit) > 1000
    assert np.abs(np.linalg.norm(hit[:, 1:4], axis=1) - 1).max() < 1e-6
    way = hit[:, 4:7] - POINT
    way /= np.linalg.norm(way, axis=1)[:, None]
    assert (way * hit[:, 1:4]).sum(axis=1).min() > 1 - 1e-6, "the end lies where the direction points"
    assert (hit[:, 7:11] >= 0).all()
    assert np.isfinite(hit).all()


def test_a_light_sample_does_not_know_its_company() -> None:
    count, random = 4096, np.random.default_rng(3)
    points, samples, order = random.uniform(-3.5, 3.5, (count, 3)), np.arange(count, dtype=np.uint32), random.permutation(count)
    scene, numbers = lit_scene(), job(0.25, 0.35, 0.4)
    here = lanes.lights(scene, numbers, points, samples, (0.0, 1.0, 0.0))[order]
    there = lanes.lights(scene, numbers, points[order], samples[order], (0.0, 1.0, 0.0))
    found = here[:, 0] != 0.0
    assert 0.5 < found.mean() < 1.0
    assert np.array_equal(here[:, 0], there[:, 0])
    assert np.array_equal(here[found], there[found])


def test_sky_is_asked_over_the_hemisphere() -> None:
    found = samples(job(1.0, 0.0, 0.0))
    assert (found[:, 0] == 1).all()
    assert found[:, 10] == pytest.approx(1 / (2 * math.pi))
    upward = found[:, 2]
    assert upward.min() >= 0
    counts = np.histogram(upward, 64, (0, 1))[0]
    assert ((counts - len(found) / 64) ** 2 / (len(found) / 64)).sum() < 64 + 6 * math.sqrt(128), "cosines are even"
    # Irradiance of a constant sky is pi times its radiance.
    irradiance = (found[:, 7:10] * upward[:, None]).mean(axis=0)
    assert irradiance == pytest.approx(math.pi * np.array([1.0, 2.0, 3.0]), rel=0.01)
    low, high = job(1, 0, 0).box_low, job(1, 0, 0).box_high
    faces = np.minimum(np.abs(found[:, 4:7] - low), np.abs(found[:, 4:7] - high)).min(axis=1)
    assert faces.max() < 1e-5, "rays to the sky end at the box"


def analytic_irradiance() -> Floats:
    """Of all emitters at the point, by cutting them into small triangles."""
    total = np.zeros(3)
    cuts = 400
    for corner, radiance, two_sided in zip(CORNERS.astype(np.float64), RADIANCE, TWO_SIDED, strict=True):
        a, b = corner[1] - corner[0], corner[2] - corner[0]
        normal = np.cross(a, b)
        area = np.linalg.norm(normal) / 2
        normal /= 2 * area
        i, j = (axis.ravel() for axis in np.meshgrid(np.arange(cuts), np.arange(cuts)))
        upper, lower = i + j < cuts, i + j < cuts - 1
        centres = [(i[upper] + 1 / 3, j[upper] + 1 / 3), (i[lower] + 2 / 3, j[lower] + 2 / 3)]
        for s, t in centres:
            way = corner[0] + (s / cuts)[:, None] * a + (t / cuts)[:, None] * b - POINT
            squared = (way**2).sum(axis=1)
            way /= np.sqrt(squared)[:, None]
            cosine = -(way @ normal)
            cosine = np.abs(cosine) if two_sided else np.maximum(cosine, 0)
            total += radiance * (cosine * np.maximum(way @ NORMAL, 0) / squared).sum() * area / cuts**2
    return total


def test_emitters_give_the_irradiance_that_geometry_says() -> None:
    found = samples(job(0.0, 0.0, 1.0))
    share = found[:, 7:10] * np.maximum(found[:, 1:4] @ NORMAL, 0)[:, None] * found[:, :1]
    error = 5 * share.std(axis=0) / math.sqrt(len(share))
    assert (np.abs(share.mean(axis=0) - analytic_irradiance()) < error + 1e-3).all()


@pytest.mark.parametrize("choose", [1.0, 0.4])
def test_densities_of_emitters_integrate_to_their_share(choose: float) -> None:
    """By uniform directions over the whole sphere: what the density says of each emitter that is seen there."""
    numbers = job(1.0 - choose, 0.0, choose)
    random = np.random.default_rng(4)
    ways = random.normal(size=(400_000, 3))
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    total = np.zeros(len(ways))
    for corner, radiance, two_sided in zip(CORNERS.astype(np.float64), RADIANCE, TWO_SIDED, strict=True):
        a, b = corner[1] - corner[0], corner[2] - corner[0]
        normal = np.cross(a, b)
        falling = ways @ normal
        t = (normal @ (corner[0] - POINT)) / falling
        hit = POINT + t[:, None] * ways - corner[0]
        u = np.cross(hit, b) @ normal / (normal @ normal)
        v = np.cross(a, hit) @ normal / (normal @ normal)
        seen = (t > 0) & (u >= 0) & (v >= 0) & (u + v <= 1) & ((falling < 0) | (two_sided != 0))
        cosine = np.abs(falling) / np.linalg.norm(normal)
        density = [probe.emitter_density(numbers, radiance.astype(np.float64), t[i] ** 2, cosine[i]) for i in np.flatnonzero(seen)]
        total[seen] += density
    found = samples(numbers)
    sky = np.isclose(found[:, 10], (1.0 - choose) / (2 * math.pi), rtol=1e-6)
    from_emitters = (found[:, 0] == 1) & ~sky
    error = 5 * 4 * math.pi * total.std() / math.sqrt(len(total)) + 0.005
    assert abs(4 * math.pi * total.mean() - from_emitters.mean()) < error, "density integrates to how often it is sampled"
    assert from_emitters.mean() <= choose + 0.005


def test_a_sample_has_the_density_that_a_path_would_tell() -> None:
    numbers = job(0.0, 0.0, 1.0)
    found = samples(numbers, 5000)
    for row in found[found[:, 0] == 1][:500]:
        # The end lies a little in front of its emitter: take it back onto the plane along the ray.
        planes = np.cross(CORNERS[:, 1] - CORNERS[:, 0], CORNERS[:, 2] - CORNERS[:, 0]).astype(np.float64)
        distances = ((CORNERS[:, 0] - POINT) * planes).sum(axis=1) / (planes @ row[1:4])
        number = int(np.abs(distances - np.linalg.norm(row[4:7] - POINT)).argmin())
        cosine = abs(planes[number] @ row[1:4]) / np.linalg.norm(planes[number])
        told = probe.emitter_density(numbers, RADIANCE[number].astype(np.float64), distances[number] ** 2, cosine)
        assert told == pytest.approx(row[10], rel=1e-4)


def test_weights_of_both_techniques_sum_to_one() -> None:
    codes = lanes.probed("to_pdf_code", np.array([1e-6, 0.1, 1 / math.pi, 40.0, 1e5]))[0]
    densities = lanes.reals_of(lanes.probed("from_pdf_code", word_columns=(codes,))[0])
    for other in (1e-5, 0.2, 7.0, 3e4):
        by_surface, by_light = lanes.reals_of(lanes.probed("power_weights", densities, np.full(len(densities), other))[:2])
        assert by_light + by_surface == pytest.approx(1.0, abs=3e-7)
        assert by_surface == pytest.approx(densities**2 / (densities**2 + other**2), rel=1e-5), "the power heuristic, of the second power"
    assert np.array_equal(lanes.probed("to_pdf_code", densities)[0], codes), "both weigh with the same coded density"


def test_weights_of_densities_whose_squares_single_precision_has_not() -> None:
    one, other = np.array([1e-30, 1e30, 1e30, 1e-30, 3e37, 0.5]), np.array([1e-30, 1e30, 1e-30, 1e30, 1e37, 0.0])
    found = lanes.reals_of(lanes.probed("power_weights", one, other)[0])
    assert found == pytest.approx([0.5, 0.5, 1.0, 0.0, 0.9, 1.0], rel=1e-5)


def test_punctual_lights() -> None:
    found = samples(job(0.0, 1.0, 0.0), 50_000)
    assert (found[:, 10] == 0).all(), "no path can find them"
    way = np.array([0.5, 3.0, 0.0]) - POINT
    squared = way @ way
    point = np.isclose(found[:, 7], 1.0 / 0.5 / squared, rtol=1e-5)
    sun = np.isclose(found[:, 7], 1.0 / 0.2, rtol=1e-5)
    assert point.mean() == pytest.approx(0.5, abs=0.01)
    assert sun.mean() == pytest.approx(0.2, abs=0.01)
    assert found[sun, 2] == pytest.approx(1.0), "towards where its light comes from"
    spot = found[~point & ~sun]
    inner, outer = math.cos(0.1), math.cos(0.5)
    angular = min(max((way[1] / math.sqrt(squared) - outer) / (inner - outer), 0), 1) ** 2
    assert spot[:, 7] == pytest.approx(angular / squared / 0.3, rel=1e-4)
    assert found[:, 8] == pytest.approx(2 * found[:, 7], rel=1e-5)


def test_where_there_is_no_light_none_is_found() -> None:
    assert not samples(job(0.0, 0.0, 0.0), 100).any()
