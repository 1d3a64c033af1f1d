"""If this fails, a part of an image that is made alone is not the part that it is in the whole."""

from __future__ import annotations

import numpy as np
import pytest

from render.rig import Rig
from render.shapes import room
from scenefold.render.window import Window

SKY = (0.1, 0.15, 0.3)


@pytest.fixture(scope="module")
def furnished() -> Rig:
    """With panes, so that the caster draws numbers, too."""
    return Rig(room(), 12)


def test_a_crop_is_equal_to_that_part_of_the_whole(furnished: Rig) -> None:
    whole = furnished.render(sky=SKY)
    for nodes, crop in ((1, Window(3, 5, 11, 13)), (2, Window(0, 0, 24, 1)), (1, Window(23, 2, 1, 22)), (1, Window(0, 0, 24, 24))):
        part = furnished.render(nodes=nodes, sky=SKY, crop=crop)
        rows, columns = slice(crop.y, crop.y + crop.height), slice(crop.x, crop.x + crop.width)
        for name, layer in part.layers.items():
            assert np.array_equal(layer, whole.layers[name][rows, columns]), (name, crop)
        assert len(part.radiance) == crop.pixels * 4, "nothing else is traced"
