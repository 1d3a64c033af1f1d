"""The camera as partitions see it: a point, the axis through it, and where angles around the axis start.

Twelve o'clock is fraction 0, and fractions grow clockwise as the camera sees it (as in the thesis, figure
4.12): `zero` is the camera's up, `quarter` its right.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from scenefold.base.errors import LocalFault
from scenefold.partition.turns import cosine_and_sine

Floats = npt.NDArray[np.float64]
Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Frame:
    """A right-handed frame: `zero` x `quarter` = `axis`; all three of unit length."""

    origin: Vector
    axis: Vector
    zero: Vector
    quarter: Vector

    def flat(self, points: Floats) -> tuple[Floats, Floats]:
        """Coordinates of points f64[n, 3] in the plane across the axis: along `zero`, along `quarter`."""
        away = points - np.array(self.origin)
        return away @ np.array(self.zero), away @ np.array(self.quarter)

    def fractions(self, points: Floats) -> Floats:
        """Angle of each point around the axis in [0, 1). For placing bounds; kernels never ask for angles."""
        x, y = self.flat(points)
        fractions = np.arctan2(y, x) / (2.0 * np.pi) % 1.0
        return np.where(fractions < 1.0, fractions, 0.0)


def camera_frame(position: npt.ArrayLike, forward: npt.ArrayLike, up: npt.ArrayLike) -> Frame:
    """The frame of a camera that looks along `forward`; `up` need not be square to it, or may even be parallel.

    The position is rounded to f32, as ray records round it: then camera rays start on the axis exactly.
    """
    origin = np.asarray(position, np.float64).reshape(3).astype(np.float32).astype(np.float64)
    axis = _unit(np.asarray(forward, np.float64).reshape(3), "the camera looks nowhere")
    zero = _across(np.asarray(up, np.float64).reshape(3), axis)
    quarter = np.cross(axis, zero)
    return Frame(_vector(origin), _vector(axis), _vector(zero), _vector(quarter / np.sqrt(quarter @ quarter)))


def turned_frame(numbers: Floats, turn: float) -> Floats:
    """Origin, zero and quarter, f64[9], with the latter two turned about the axis by a fraction of a turn.

    They are made square and of unit length again, so that any number of turns leaves a frame.
    """
    cosine, sine = cosine_and_sine(turn % 1.0)
    zero, quarter = numbers[3:6], numbers[6:9]
    across = _unit(cosine * zero + sine * quarter, "no frame")
    beside = cosine * quarter - sine * zero
    beside = _unit(beside - across * (across @ beside), "no frame")
    return np.concatenate([numbers[:3], across, beside])


def _across(up: Floats, axis: Floats) -> Floats:
    """The unit vector across the axis that is nearest to up, or any if up lies along the axis."""
    length = np.sqrt(up @ up)
    if np.isfinite(length) and length > 0.0:
        across = up / length - axis * (up / length @ axis)
        if across @ across > 1e-12:
            across = _unit(across, "no up")
            return _unit(across - axis * (across @ axis), "no up")  # twice is enough
    return _across(np.eye(3)[int(np.argmin(np.abs(axis)))], axis)


def _unit(vector: Floats, fault: str) -> Floats:
    length = np.sqrt(vector @ vector)
    if not (np.isfinite(length) and length > 0.0):
        raise LocalFault(fault, remedy="give a camera direction that is finite and not zero")
    return vector / length


def _vector(array: Floats) -> Vector:
    return (float(array[0]), float(array[1]), float(array[2]))
