"""The cells with which a job begins, by the algorithm that a user asks for (specs/29-moving-cells.md, Options)."""

from __future__ import annotations

import numpy as np

from scenefold.partition import Partition, camera_frame, make_partition
from scenefold.partition.registry import load_algorithm
from scenefold.partition.rules import Measured
from scenefold.render.content import pair_boxes
from scenefold.render.numbers import job_box
from scenefold.scene.payloads.cameras import Camera
from scenefold.scene.tables import SceneTables


def first_cells(name: str, nodes: int, tables: SceneTables, camera: Camera) -> Partition:
    """By where geometry lies, before any ray flew; epoch 1."""
    _, groups, low, high = pair_boxes(tables)
    box, weights = np.stack(job_box(tables)), tables.groups.triangles[groups].astype(np.float64)
    matrix = np.asarray(camera.matrix, np.float64)
    position, forward, up, centres = matrix[:3, 3], -matrix[:3, 2], matrix[:3, 1], (low + high) * 0.5
    match name:
        case "voronoi" | "whole":
            return make_partition("voronoi", nodes, box, position, forward, up, centres, weights)
        case "bounded-radial" | "radial":
            return make_partition("bounded-radial", nodes, box, position, forward, up, centres, weights)
    measured = Measured(np.zeros(nodes), centres, weights, box, np.stack([low, high], axis=1))
    return load_algorithm(name).first(measured, nodes, camera_frame(position, forward, up))
