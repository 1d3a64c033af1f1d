"""If this fails, light stops at what lets it pass, and the shader, which counts on that, gives back too much."""

from __future__ import annotations

import numpy as np
import pytest

from scenefold.render.arrays import Feature, MaterialColumn
from scenefold.render.see_through_kernels import is_see_through


@pytest.mark.parametrize(
    ("alpha_mode", "transmission", "metallic", "texture", "passes"),
    [
        (0, 0.0, 0.0, -1, False),
        (1, 0.0, 0.0, -1, True),
        (2, 0.0, 1.0, -1, True),
        (0, 0.5, 0.0, -1, True),
        (0, 1.0, 1.0, -1, False),
        # The factor is 1, and the texture says where there is metal at all.
        (0, 1.0, 1.0, 3, True),
        (0, 0.0, 1.0, 3, False),
    ],
)
def test_what_may_pass_a_material(alpha_mode: int, transmission: float, metallic: float, texture: int, passes: bool) -> None:
    row = np.zeros(MaterialColumn.WIDTH, np.float32)
    row[MaterialColumn.ALPHA_MODE], row[MaterialColumn.TRANSMISSION], row[MaterialColumn.METALLIC] = alpha_mode, transmission, metallic
    row[MaterialColumn.METALLIC_ROUGHNESS_USE] = texture
    assert is_see_through(row) == passes
    for feature in (Feature.ROUGH_TRANSMISSION, Feature.SOLID):
        row[MaterialColumn.FEATURES] = feature
        assert is_see_through(row) == (alpha_mode != 0), "what scatters is the shader's"
