"""Where nodes start (thesis 3.3.6): four placements, pure functions of a box, a camera and a seed.

Each returns centroids f64[N, 3]. `random` and `van_der_corput` fill the scene's box; `planar` and `radial` go by
the camera, because collisions do (figure 3.8).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from scenefold.base.errors import LocalFault
from scenefold.partition.bounds import even_bounds
from scenefold.partition.frame import Frame
from scenefold.partition.turns import cosine_and_sine

Floats = npt.NDArray[np.float64]

_PRIMES = (2, 3, 5)
_RADIUS = 0.25
"""Of the box's longest side: the circle of `radial`. The cells are the same wedges for every radius."""


def checked_box(box: npt.ArrayLike) -> Floats:
    """f64[2, 3], low corner and high corner; LocalFault if it is none."""
    corners = np.asarray(box, np.float64)
    if corners.shape != (2, 3) or not np.isfinite(corners).all() or not (corners[0] <= corners[1]).all():
        raise LocalFault("a box is a low and a high corner, both finite")
    return corners


def random(box: npt.ArrayLike, nodes: int, seed: int) -> Floats:
    """Scattered evenly at random: needs no agreement between nodes, but clumps."""
    low, high = _corner_pair(box)
    return low + (high - low) * np.random.Generator(np.random.PCG64(seed)).random((nodes, 3))


def van_der_corput(box: npt.ArrayLike, nodes: int, seed: int | None = None) -> Floats:
    """Radical inverses, another prime base on each axis; with a seed, shifted around the box by random amounts."""
    low, high = _corner_pair(box)
    shift = np.zeros(3) if seed is None else np.random.Generator(np.random.PCG64(seed)).random(3)
    inverses = np.array([[_radical_inverse(i, base) for base in _PRIMES] for i in range(1, nodes + 1)])
    return low + (high - low) * ((inverses + shift) % 1.0)


def planar(box: npt.ArrayLike, nodes: int, frame: Frame) -> Floats:
    """Evenly along the camera axis, as deep as the box is: the cells are slices across the axis."""
    depths = (_corners(checked_box(box)) - np.array(frame.origin)) @ np.array(frame.axis)
    near, far = float(depths.min()), float(depths.max())
    steps = near + (far - near) * (np.arange(nodes) + 0.5) / nodes
    centroids: Floats = np.array(frame.origin) + steps[:, None] * np.array(frame.axis)
    return centroids


def radial(box: npt.ArrayLike, nodes: int, frame: Frame, bounds: npt.ArrayLike | None = None) -> Floats:
    """On a circle around the camera axis, abreast of the box's centre: the cells are wedges around the axis.

    Evenly, or in the middle of the spans between given inner bounds (the cells' hulls then lie between the
    nodes, and so only near these bounds). In a thin box the circle sticks out: a squeezed one would make no wedges.
    """
    low, high = _corner_pair(box)
    inner = even_bounds(nodes) if bounds is None else np.asarray(bounds, np.float64)
    spans = np.concatenate([[0.0], inner, [1.0]])
    ring = np.array([cosine_and_sine(float(middle)) for middle in (spans[:-1] + spans[1:]) / 2.0])
    axis = np.array(frame.axis)
    centre = np.array(frame.origin) + axis * max(float((0.5 * (low + high) - np.array(frame.origin)) @ axis), 0.0)
    radius = _RADIUS * (float((high - low).max()) or 1.0)
    centroids: Floats = centre + radius * (ring[:, :1] * np.array(frame.zero) + ring[:, 1:] * np.array(frame.quarter))
    return centroids


def _corner_pair(box: npt.ArrayLike) -> tuple[Floats, Floats]:
    corners = checked_box(box)
    return corners[0], corners[1]


def _corners(box: Floats) -> Floats:
    return np.array([[box[i, 0], box[j, 1], box[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])


def _radical_inverse(index: int, base: int) -> float:
    """The digits of index mirrored behind the point: 6 = 110 in base 2 becomes 0.011 = 3/8."""
    value, digit = 0.0, 1.0 / base
    while index:
        value += digit * (index % base)
        index //= base
        digit /= base
    return value
