"""How far each prototype's box is widened, so that Embree's rounding of instances' boxes hides no hit; see geometry.py.

One pass over groups and one over instances: a scene may have tens of thousands of either.
"""

from __future__ import annotations

import numpy as np

from scenefold.render.arrays import F64
from scenefold.render.contract import HeldScene

_ROUNDING = 2.0**-19
"""Sixteen units of the last place of f32: more than carrying a box into the world can lose."""


def widened_boxes(scene: HeldScene) -> dict[int, tuple[F64, F64]]:
    """Low and high corner f64[3] of each held prototype but 0, in its own space, with room for what its instances' matrices round off."""
    boxes = _boxes(scene)
    numbers = sorted(boxes)
    if not numbers:
        return {}
    low, high = (np.array([boxes[number][side] for number in numbers]) for side in (0, 1))
    reach = np.maximum(np.abs(low), np.abs(high))
    room = np.zeros(len(numbers))
    held = np.array([pair for pair in scene.instances if pair[1] in boxes], np.int64).reshape(-1, 2)
    if len(held):
        which = np.searchsorted(numbers, held[:, 1])
        matrices = scene.arrays.instance_matrices[held[:, 0]]
        linear, moved = matrices[:, :, :3], np.abs(matrices[:, :, 3])
        rounding = _ROUNDING * ((np.abs(linear) * reach[which][:, None, :]).sum(axis=2) + moved).max(axis=1)
        np.maximum.at(room, which, rounding * np.abs(np.linalg.inv(linear)).sum(axis=2).max(axis=1))
    room += _ROUNDING * reach.max(axis=1)
    return {number: (low[at] - room[at], high[at] + room[at]) for at, number in enumerate(numbers)}


def _boxes(scene: HeldScene) -> dict[int, tuple[F64, F64]]:
    """Of the held triangles of each prototype but 0."""
    arrays = scene.arrays
    boxes: dict[int, tuple[F64, F64]] = {}
    for held in scene.groups:
        if held.prototype == 0:
            continue
        first = int(arrays.group_first[held.group])
        corners = arrays.vertices[arrays.triangles[first : first + held.triangles].ravel()].astype(np.float64)
        low, high = corners.min(axis=0), corners.max(axis=0)
        near, far = boxes.get(held.prototype, (low, high))
        boxes[held.prototype] = np.minimum(near, low), np.maximum(far, high)
    return boxes
