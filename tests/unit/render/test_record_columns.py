"""If this fails, a renderer that reads records in numpy sees other rays than the kernels wrote."""

from __future__ import annotations

import numpy as np
import pytest

from render.rig import Rig
from render.shapes import looking, room
from scenefold.base.rays import KIND_SHADOW, RAY_WORDS
from scenefold.render.numbers import job_numbers
from scenefold.render.record_columns import camera_rays, path_rays


@pytest.mark.parametrize("kind", ["perspective", "orthographic"])
@pytest.mark.parametrize("eye", [(3.0, 2.0, 5.0), (-3.0, -2.0, -5.0), (0.0, 5.0, 0.0)])
def test_camera_rays_pass_through_their_pixels(kind: str, eye: tuple[float, float, float]) -> None:
    rig = Rig(room(camera=looking(eye, (0.1, 0.0, 0.2), kind=kind, ymag=1.0, yfov=0.5)), 40)
    job = rig.job("voronoi", 1, width=7, height=5, samples=2)
    numbers = job_numbers(job, rig.tables)
    rays = path_rays(camera_rays(numbers, 0, 70), 70)
    camera = numbers.camera
    assert rays.is_camera.all()
    assert rays.paths.tolist() == list(range(70))
    assert np.array_equal(rays.throughputs, np.ones((70, 3)))
    assert np.abs((rays.directions**2).sum(axis=1) - 1).max() < 1e-12
    away = rays.origins - camera[0:3]
    along = rays.directions if kind == "perspective" else away
    depth = along @ camera[9:12] if kind == "perspective" else np.ones(70)
    x = (along @ camera[3:6] / depth / camera[12] + 1) * 3.5
    y = (1 - along @ camera[6:9] / depth / camera[13]) * 2.5
    pixels = np.arange(70) % 35 * numbers.stride % 35
    assert np.array_equal(np.floor(x), pixels % 7)
    assert np.array_equal(np.floor(y), pixels // 7)
    if kind == "orthographic":
        assert np.abs(rays.directions - camera[9:12]).max() < 1e-6
    else:
        assert np.abs(np.cross(away, rays.directions)).max() < 1e-5


def test_what_is_no_path_ray_is_left_out() -> None:
    rays = np.zeros((5, RAY_WORDS), np.uint32)
    rays[:, 7] = np.arange(5, dtype=np.uint32) << 16
    rays[1, 8] = KIND_SHADOW << 8
    rays[2, 0] = 0x7FC00000
    assert path_rays(rays, 4).paths.tolist() == [0, 3], "a shadow ray, one that is no number, and one of another pass are not there"
