"""If this fails, the depth layer says something else than how far a pixel's surface is, from near or from very far."""

from __future__ import annotations

import numpy as np
import pytest

from render.rig import Rig
from render.shapes import ball, looking, scene
from scenefold.render.numbers import depth_of_box
from scenefold.scene.payloads.materials import Material

RADIUS, SIDE = 1.0, 8
BOX = (np.array([-1.0, -2.0, -3.0]), np.array([1.0, 2.0, 3.0]))


@pytest.mark.parametrize("distance", [2.0, 20.0, 5000.0])
@pytest.mark.parametrize("kind", ["perspective", "orthographic"])
def test_depth_is_the_distance_from_near_and_from_thousands_of_diagonals_away(distance: float, kind: str) -> None:
    """Of a ball that fills the middle of the view, in single precision."""
    half = 0.2 * RADIUS
    view = {"yfov": 2 * np.arctan(half / distance)} if kind == "perspective" else {"kind": kind, "ymag": half}
    eye = looking((0, 0, distance), (0, 0, 0), **view)
    depth = (
        Rig(scene([[ball((0, 0, 0), RADIUS, 40, 0)]], [Material()], [eye]), 400)
        .render("voronoi", 1, width=SIDE, height=SIDE)
        .layers["depth"]
    )
    # The chords of a ball of 80 x 40 facets lie up to a thousandth of its radius beneath it.
    nearest, farthest = distance - RADIUS, distance - RADIUS * np.sqrt(1 - 2 * 0.2**2) + 0.2**2
    rounding = 2.0**-22 * distance
    assert (depth >= nearest - rounding).all() and (depth <= farthest + 2e-3 * RADIUS + rounding).all()


@pytest.mark.parametrize(
    ("place", "ahead", "kind", "expected"),
    [
        ((0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 0.0, 0.0),
        ((0.0, 0.0, 10.0), (0.0, 0.0, -1.0), 0.0, 7.0),
        ((4.0, 6.0, 0.0), (0.0, 0.0, -1.0), 0.0, 5.0),
        ((4.0, 6.0, 0.0), (0.0, 0.0, -1.0), 1.0, 0.0),
        ((4.0, 6.0, 10.0), (0.0, 0.0, -1.0), 1.0, 7.0),
        ((0.0, 0.0, 10.0), (0.0, 0.0, 1.0), 1.0, 0.0),
        ((10.0, 10.0, 0.0), (-0.8, -0.6, 0.0), 1.0, 0.8 * 9.0 + 0.6 * 8.0),
    ],
)
def test_where_a_box_begins(place: tuple[float, ...], ahead: tuple[float, ...], kind: float, expected: float) -> None:
    camera = (*place, *(0.0,) * 6, *ahead, 1.0, 1.0, kind)
    assert depth_of_box(camera, BOX) == pytest.approx(expected, abs=1e-12)
