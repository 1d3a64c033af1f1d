"""If this fails, paths belong to other pixels than the specification says, and a part of an image to another part of it."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from scenefold.render.generate_kernels import scattering_stride
from scenefold.render.pixel_kernels import pixel_of


def pixels_of(width: int, height: int, crop: tuple[int, int, int, int], paths: int) -> list[tuple[int, int]]:
    x, y, crop_width, crop_height = crop
    stride = scattering_stride(crop_width * crop_height)
    job = SimpleNamespace(width=width, height=height, stride=stride, crop_x=x, crop_y=y, crop_width=crop_width, crop_height=crop_height)
    found = [pixel_of.py_func(job, np.uint64(number)) for number in range(paths)]
    return [(int(pixel), int(sample)) for pixel, sample in found]


def test_paths_of_a_whole_image_are_where_the_specification_puts_them() -> None:
    stride = scattering_stride(35)
    assert pixels_of(7, 5, (0, 0, 7, 5), 80) == [(number % 35 * stride % 35, number // 35) for number in range(80)]


@pytest.mark.parametrize("crop", [(0, 0, 1, 1), (2, 1, 4, 3), (6, 0, 1, 5), (0, 4, 7, 1)])
def test_each_pixel_of_a_part_has_each_sample_once_and_its_number_in_the_whole(crop: tuple[int, int, int, int]) -> None:
    x, y, width, height = crop
    inside = {(row * 7 + column, sample) for row in range(y, y + height) for column in range(x, x + width) for sample in range(3)}
    found = pixels_of(7, 5, crop, 3 * width * height)
    assert set(found) == inside and len(found) == len(inside)
