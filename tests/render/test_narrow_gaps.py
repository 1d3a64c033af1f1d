"""If this fails, what is large or far away in a scene lets light under things, or surfaces shadow themselves."""

from __future__ import annotations

import numpy as np
import pytest

from render.rig import Rig
from render.shapes import grid, looking, scene
from scenefold.scene.importers.source import MeshPart, SourceScene
from scenefold.scene.payloads.materials import Material
from scenefold.scene.payloads.punctual import PunctualLight

GREY = Material(base_color=(0.5, 0.5, 0.5, 1.0), metallic=0.0, roughness=1.0)
SUN = PunctualLight(kind="directional", direction=(0.0, -1.0, 0.0), color=(3.0, 3.0, 3.0))
SLANTED = PunctualLight(kind="directional", direction=(0.6, -0.64, 0.48), color=(3.0, 3.0, 3.0))
GAP = 0.02


def square(half: float, height: float, at: float = 0.0) -> MeshPart:
    return grid((at - half, height, half), (2 * half, 0, 0), (0, 0, -2 * half), 2, 0)


def under_a_plate(*others: MeshPart, lamp_at: float = 0.0) -> SourceScene:
    """A ground, a plate a little above it, the sun straight above, and the camera between both."""
    lights = [SUN]
    if lamp_at:
        lights.append(PunctualLight(kind="point", position=(0.0, lamp_at, 0.0), color=(1e-6, 1e-6, 1e-6)))
    camera = looking((-0.9, 0.75 * GAP, 0), (-0.88, 0.0, 0), yfov=0.5)
    return scene([[square(1.0, 0.0), square(1.0, GAP), *others]], [GREY], [camera], punctual=lights)


@pytest.mark.parametrize(
    "dark", [under_a_plate(), under_a_plate(lamp_at=20_000.0), under_a_plate(square(5_000.0, -1.0))], ids=["alone", "lamp", "ground"]
)
def test_what_is_far_away_lets_no_light_under_a_plate(dark: SourceScene) -> None:
    image = Rig(dark).render(width=16, height=16, samples=8, depth=2)
    assert image.beauty.max() < 1e-5


@pytest.mark.parametrize("light", [SUN, SLANTED], ids=["straight", "slanted"])
@pytest.mark.parametrize(("half", "at"), [(1e-3, 0.0), (1.0, 0.0), (1e4, 0.0), (1.0, 1e3), (1.0, -3e4)])
def test_no_surface_shadows_itself(half: float, at: float, light: PunctualLight) -> None:
    tilted = grid((at - half, 0.1 * half, half), (2 * half, 0.05 * half, 0), (0, 0.07 * half, -2 * half), 2, 0)
    camera = looking((at, 3.0 * half, 0.01 * half), (at, 0.0, 0.0), kind="orthographic", ymag=0.8 * half)
    image = Rig(scene([[tilted]], [GREY], [camera], punctual=[light])).render(width=16, height=16, samples=16, depth=2)
    assert np.ptp(image.beauty[..., 0]) < 0.02 * image.beauty[..., 0].mean()
