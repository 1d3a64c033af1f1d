"""If this fails, a lamp is asked so seldom that its light is noise, or more often than its light is weighed for."""

from __future__ import annotations

import numpy as np
import pytest

from render.rig import Rig
from render.shapes import grid, looking, scene
from scenefold.render.arrays import LightColumn
from scenefold.render.numbers import punctual_rows
from scenefold.scene.payloads.materials import Material
from scenefold.scene.payloads.punctual import PunctualLight


@pytest.mark.parametrize("half", [1.0, 1e4])
def test_every_lamp_is_asked_however_strong_the_sun_is(half: float) -> None:
    sun = PunctualLight(kind="directional", direction=(0.0, -1.0, 0.0), color=(1e5, 1e5, 1e5))
    lamps = [PunctualLight(kind="point", position=(0.0, 1.0, float(place)), color=(1.0, 1.0, 1.0)) for place in range(3)]
    ground = grid((-half, 0, half), (2 * half, 0, 0), (0, 0, -2 * half), 1, 0)
    rig = Rig(scene([[ground]], [Material()], [looking((0, 2, 0.1), (0, 0, 0))], punctual=[sun, *lamps]))
    chances = punctual_rows(rig.tables)[:, LightColumn.PROBABILITY]
    assert chances.sum() == pytest.approx(1.0)
    assert (chances >= 0.5 / 4).all()
    assert chances[0] > 0.6, "and the strongest most often"
    assert np.ptp(chances[1:]) == 0.0
