"""If this fails, a pass lacks paths or has some twice, or its rays meet the scene in an order that no cache can follow."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from scenefold.render.arrays import JobNumbers
from scenefold.render.generate_kernels import scattering_stride
from scenefold.render.lanes_kernels import LANES
from scenefold.render.order_kernels import PathOrder
from scenefold.render.pixel_kernels import pixel_of


def made_job(width: int, height: int) -> Any:
    # Of a class of the product: kernels keep the classes that they were compiled for in their cache, which other processes read.
    nothing: list[Any] = [0] * len(JobNumbers._fields)
    size = {"width": width, "height": height, "crop_width": width, "crop_height": height}
    return JobNumbers(*nothing)._replace(stride=scattering_stride(width * height), **size)


def places_of(job: Any, first_path: int, order: npt.NDArray[np.uint32]) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    pixels = np.array([int(pixel_of.py_func(job, np.uint64(first_path + int(path)))[0]) for path in order], np.int64)
    return pixels % job.width, pixels // job.width


@pytest.mark.parametrize(("width", "height"), [(1, 1), (3, 200), (640, 360), (300, 7)])
@pytest.mark.parametrize(("first_path", "count"), [(0, 1), (5, 1000), (123_456_789_012, 4099)])
def test_each_path_of_a_pass_is_made_once(width: int, height: int, first_path: int, count: int) -> None:
    order = PathOrder(made_job(width, height)).of_pass(first_path, count)
    assert len(order) == -(-count // LANES) * LANES
    assert np.array_equal(np.sort(order[:count]), np.arange(count))
    assert not order[count:].any()


@pytest.mark.parametrize(("width", "height"), [(640, 360), (128, 128), (50, 300)])
def test_neighbours_follow_each_other(width: int, height: int) -> None:
    job, count, first = made_job(width, height), 16_384, 777_777
    x, y = places_of(job, first, PathOrder(job).of_pass(first, count)[:count])
    tiles = np.zeros(count, np.int64)
    for bit in range(7):
        tiles |= ((x * 128 // width >> bit) & 1) << 2 * bit | ((y * 128 // height >> bit) & 1) << (2 * bit + 1)
    assert (np.diff(tiles) >= 0).all()
    steps = np.abs(np.diff(x)) / width + np.abs(np.diff(y)) / height
    assert steps.mean() < 1 / 30
