"""If this fails, what a lens blurs is blurred by another shape, or what should be sharp is not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from render.rig import Rig
from render.shapes import looking, room
from scenefold.base.errors import UsageFault
from scenefold.render.client import StillOptions
from scenefold.render.lens import Lens
from scenefold.render.numbers import job_numbers
from scenefold.render.record_columns import camera_rays, path_rays

RADIUS, FOCUS, PATHS = 0.25, 3.5, 35 * 1024


@pytest.mark.parametrize("kind", ["perspective", "orthographic"])
@pytest.mark.parametrize("eye", [(3.0, 2.0, 5.0), (0.2, 0.1, 0.3)])
def test_rays_come_from_all_of_the_lens_and_meet_in_the_plane_of_focus(kind: str, eye: tuple[float, float, float]) -> None:
    rig = Rig(room(camera=looking(eye, (0.1, 0.0, 0.2), kind=kind, ymag=1.0, yfov=0.5)), 40)
    numbers = job_numbers(rig.job("voronoi", 1, width=7, height=5, samples=PATHS // 35, lens=Lens(RADIUS, FOCUS)), rig.tables)
    rays = path_rays(camera_rays(numbers, 0, PATHS), PATHS)
    camera = numbers.camera
    axes = np.stack([camera[3:6], camera[6:9], camera[9:12]], axis=1)
    away, directions = (rays.origins - camera[0:3]) @ axes, rays.directions @ axes
    assert (away[:, 2] > -1e-5).all(), "nothing begins behind the lens"
    at_lens = away - directions * (away[:, 2] / directions[:, 2])[:, None]
    sharp = at_lens + directions * (FOCUS / directions[:, 2])[:, None]
    sharp = sharp[:, :2] / FOCUS if kind == "perspective" else sharp[:, :2]
    pixels = np.arange(PATHS) % 35 * numbers.stride % 35
    x, y = (sharp[:, 0] / camera[12] + 1) * 3.5, (1 - sharp[:, 1] / camera[13]) * 2.5
    assert np.abs(x - pixels % 7 - 0.5).max() < 0.5001
    assert np.abs(y - pixels // 7 - 0.5).max() < 0.5001
    if kind == "orthographic":  # what lies about the centre of its own lens
        at_lens[:, :2] -= sharp
    _expect_even_disk(at_lens[:, :2] / RADIUS)


def _expect_even_disk(points: np.ndarray[Any, np.dtype[np.float64]]) -> None:
    """Chi-square over 8 rings by 16 sectors of one area each: even, and by far not as uneven as chance would be at 1e-4."""
    ring = np.minimum(((points**2).sum(axis=1) * 8).astype(int), 8)
    sector = ((np.arctan2(points[:, 1], points[:, 0]) / (2 * np.pi) % 1.0) * 16).astype(int) % 16
    assert ((points**2).sum(axis=1) < 1.001).all()
    counts = np.bincount(np.minimum(ring, 7) * 16 + sector, minlength=128)
    expected = len(points) / 128
    assert ((counts - expected) ** 2 / expected).sum() < 196.0


def test_a_lens_needs_both_of_its_numbers() -> None:
    assert StillOptions(aperture=0.1, focus=2.0).checked().lens == Lens(0.1, 2.0)
    assert StillOptions().checked().lens is None
    for aperture, focus, named in (
        (0.1, None, "focus"),
        (None, 2.0, "aperture"),
        (0.0, 2.0, "aperture"),
        (-1.0, 2.0, "aperture"),
        (float("nan"), 2.0, "aperture"),
        (0.1, 0.0, "focus"),
        (0.1, float("inf"), "focus"),
    ):
        with pytest.raises(UsageFault) as caught:
            StillOptions(aperture=aperture, focus=focus).checked()
        assert caught.value.where == named


def test_a_lens_travels_as_plain_values() -> None:
    assert Lens.of_row(Lens(0.5, 2.0).row()) == Lens(0.5, 2.0)
    assert Lens.of_row(None) is None
    for wrong in (5, [1.0], [1.0, 2.0, 3.0], [1.0, "x"], [1.0, float("inf")]):
        with pytest.raises((TypeError, ValueError)):
            Lens.of_row(wrong)
