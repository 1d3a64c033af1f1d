"""If this fails, a crop or a preview shows another part of the image than it should."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as some

from scenectl.image_values import Crop
from scenefold.base.errors import UsageFault
from scenefold.render.client import StillOptions
from scenefold.render.window import Window
from scenefold.wire import RenderSettings


def test_a_crop_is_read_as_it_is_written() -> None:
    crop = Crop.parse("100, 50,64,48")
    assert crop.numbers == (100, 50, 64, 48) and str(crop) == "100,50,64,48"
    for wrong in ("", "1,2,3", "1,2,3,4,5", "1,2,0,4", "1,2,3,00", "-1,2,3,4", "1,2,3,x", "1.5,2,3,4"):
        with pytest.raises(ValueError, match="a crop is"):
            Crop.parse(wrong)


def test_a_preview_is_an_image_of_a_smaller_size() -> None:
    preview, whole = StillOptions(width=100, height=50, scale=0.25).checked(), StillOptions(width=25, height=12).checked()
    assert preview == whole
    assert StillOptions(scale=0.5).checked(RenderSettings(width=90, height=30)).window == Window(0, 0, 45, 15)
    tiny = StillOptions(width=3, height=2, scale=1e-3).checked()
    assert (tiny.width, tiny.height) == (1, 1)


def test_a_crop_is_of_the_image_before_it_is_made_smaller() -> None:
    asked = StillOptions(width=100, height=80, scale=0.25, crop=Window(10, 20, 9, 8)).checked()
    assert (asked.width, asked.height) == (25, 20)
    assert asked.crop == Window(2, 5, 3, 2), "every pixel that shows anything of it"


@pytest.mark.parametrize(
    "wrong", [{"scale": 0.0}, {"scale": -1.0}, {"scale": 1.5}, {"scale": float("nan")}, {"crop": Window(0, 0, 641, 1)}]
)
def test_nonsense_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(UsageFault):
        StillOptions(**wrong).checked()


sides = some.integers(1, 300)


@given(some.data(), sides, sides, some.floats(1e-3, 1.0))
def test_a_smaller_crop_lies_in_the_smaller_image(data: some.DataObject, width: int, height: int, scale: float) -> None:
    x, y = data.draw(some.integers(0, width - 1)), data.draw(some.integers(0, height - 1))
    crop = Window(x, y, data.draw(some.integers(1, width - x)), data.draw(some.integers(1, height - y)))
    asked = StillOptions(width=width, height=height, scale=scale, crop=crop).checked()
    assert asked.crop is not None
    asked.crop.check(asked.width, asked.height)
