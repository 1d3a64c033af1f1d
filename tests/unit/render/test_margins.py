"""If this fails, a ray that touches an instance is lost on one node and found on another, or a scene of many instances takes minutes to open."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from scenefold.render.contract import HeldGroup, HeldScene
from scenefold.render.renderers.embree.margins import widened_boxes

PROTOTYPES = 40
TRIANGLES = 5


def scene(seed: int, instances: int) -> HeldScene:
    """Two groups of each prototype from 0 on; instance 0 is the identity, the others are turned, squeezed and mirrored at will."""
    random = np.random.default_rng(seed)
    groups = [HeldGroup(number, number // 2, TRIANGLES) for number in range(2 * PROTOTYPES)]
    arrays: Any = SimpleNamespace(
        vertices=random.normal(0, 100, (2 * PROTOTYPES * TRIANGLES * 3, 3)).astype(np.float32),
        triangles=np.arange(2 * PROTOTYPES * TRIANGLES * 3, dtype=np.uint32).reshape(-1, 3),
        group_first=np.arange(2 * PROTOTYPES, dtype=np.int64) * TRIANGLES,
        instance_matrices=random.normal(0, 10, (instances, 3, 4)).astype(np.float32).astype(np.float64),
    )
    # Of the last prototype there is no instance, and some are of one that is not held.
    pairs = tuple((number, int(random.integers(1, PROTOTYPES - 1)) if number % 7 else PROTOTYPES + 3) for number in range(1, instances))
    return HeldScene(arrays, tuple(groups), pairs)


def test_a_box_holds_its_triangles_and_what_each_matrix_of_its_instances_rounds_off() -> None:
    held = scene(1, 300)
    boxes = widened_boxes(held)
    assert sorted(boxes) == list(range(1, PROTOTYPES))
    for prototype, (low, high) in boxes.items():
        corners = held.arrays.vertices[prototype * 2 * TRIANGLES * 3 : (prototype + 1) * 2 * TRIANGLES * 3].astype(float)
        near, far = corners.min(axis=0), corners.max(axis=0)
        reach = np.maximum(np.abs(near), np.abs(far))
        wanted = 0.0
        for instance in [number for number, other in held.instances if other == prototype]:
            matrix = held.arrays.instance_matrices[instance]
            lost = 2.0**-19 * float((np.abs(matrix[:, :3]) @ reach + np.abs(matrix[:, 3])).max())
            wanted = max(wanted, lost * float(np.abs(np.linalg.inv(matrix[:, :3])).sum(axis=1).max()))
        wanted += 2.0**-19 * float(reach.max())
        assert np.allclose(near - low, wanted, rtol=1e-6) and np.allclose(high - far, wanted, rtol=1e-6)


def test_nothing_is_widened_where_nothing_is_an_instance() -> None:
    held = scene(2, 1)
    assert widened_boxes(HeldScene(held.arrays, held.groups[:2], ())) == {}
