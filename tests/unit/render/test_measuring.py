"""If this fails, `scenectl bench render` has no figures, or figures about other rays than the renderer casts."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trio

from scenefold.render.bench import measure_renderer
from scenefold.render.contract import MeasuredRenderer, load_renderer
from scenefold.render.in_memory import one_node_job
from scenefold.render.job import RenderOptions
from scenefold.scene.cornell import LAMP, cornell_box
from scenefold.scene.importers import read_scene
from scenefold.scene.importers.source import MeshPart
from scenefold.world import offline_world

OPTIONS = RenderOptions(width=24, height=16, samples=2)


@pytest.fixture(scope="module")
def cornell(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("scene") / "cornell.glb"
    file.write_bytes(cornell_box())
    return file


@pytest.fixture(scope="module")
def report(cornell: Path) -> dict[str, Any]:
    return trio.run(partial(measure_renderer, cornell, OPTIONS, offline_world().workers, repetitions=2))


def test_the_figures_fit_together(report: dict[str, Any]) -> None:
    assert report["triangles"] == 36
    assert report["paths"] == 24 * 16 * 2
    assert report["rays_per_path"] == report["rays"] / report["paths"] > 1
    assert sum(report["stage_share"].values()) == pytest.approx(1.0)
    for name in ("paths_per_s", "rays_per_s", "caster_rays_per_s", "embree_rays_per_s", "kept", "caster_kept"):
        assert 0 < report[name]["min"] <= report[name]["median"] <= report[name]["max"]


def test_the_bare_rate_is_taken_on_the_rays_of_the_render(report: dict[str, Any]) -> None:
    # Only camera rays that pass the box by are cast by nobody.
    missing = report["rays"] - report["captured_rays"]
    assert 0 <= missing < report["paths"]
    assert 0.2 < report["captured_shadow_share"] < 0.6


async def test_a_file_becomes_a_job_of_one_node_that_holds_everything(cornell: Path) -> None:
    one = await one_node_job(cornell, OPTIONS, "any", offline_world().workers)
    assert one.job.partition.nodes == 1
    assert sum(group.triangles for group in one.loaded.held.groups) == 36
    assert isinstance(load_renderer("embree"), MeasuredRenderer)


async def test_a_job_of_one_node_may_have_an_environment_map(cornell: Path, tmp_path: Path) -> None:
    sky = tmp_path / "sky.hdr"
    sky.write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 4\n" + 8 * bytes([128, 128, 128, 129]))
    one = await one_node_job(cornell, OPTIONS, "any", offline_world().workers, sky)
    assert one.loaded.numbers.has_environment and one.loaded.held.arrays.environment.shape == (2, 4, 3)


def test_the_box_has_the_measures_that_it_is_compared_by(cornell: Path) -> None:
    source = read_scene(cornell)
    areas = [_area(part) for mesh in source.meshes for part in mesh]
    assert len(source.cameras) == 1
    assert max(float(np.max(material.emissive)) for material in source.materials) == pytest.approx(max(LAMP), rel=1e-6)
    assert sum(areas) == pytest.approx(5 * 4 + 6 * 0.36 + 2 * 0.36 + 4 * 0.6 * 1.22 + 0.46 * 0.38, rel=1e-5)


def _area(part: MeshPart) -> float:
    corners = part.positions.astype(np.float64)[part.triangles]
    return float(0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum())
