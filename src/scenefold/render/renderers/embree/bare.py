"""The bare rate: the same rays through embreex's own interface, which is what a renderer can keep of at most.

One mesh in world space, instances flattened, no cells, no filter, no records: a closest hit for a path ray, an
occlusion test for a shadow ray, in the batches in which the renderer cast them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from scenefold.render.arrays import F32, U32
from scenefold.render.contract import HeldScene
from scenefold.render.lanes_kernels import LANES
from scenefold.render.renderers.embree.measuring_kernels import unpack_rays


@dataclass(frozen=True, slots=True)
class BareBatch:
    """One batch as embreex takes it: float32[n, 3] each, and float32[n] reaches of 1 for shadow rays."""

    path_origins: F32
    path_directions: F32
    shadow_origins: F32
    shadow_directions: F32
    reaches: F32


def bare_scene(held: HeldScene) -> EmbreeScene:
    """The held triangles as one embreex mesh in world space."""
    arrays = held.arrays
    groups_of: dict[int, list[U32]] = {}
    for group in held.groups:
        first = int(arrays.group_first[group.group])
        groups_of.setdefault(group.prototype, []).append(arrays.triangles[first : first + group.triangles])
    vertices: list[F32] = [arrays.vertices]
    triangles: list[U32] = list(groups_of.get(0, []))
    count = len(arrays.vertices)
    for instance, prototype in held.instances:
        if prototype not in groups_of:
            continue
        used, corners = np.unique(np.concatenate(groups_of[prototype]), return_inverse=True)
        matrix = arrays.instance_matrices[instance]
        points = arrays.vertices[used].astype(np.float64) @ matrix[:, :3].T + matrix[:, 3]
        vertices.append(points.astype(np.float32))
        triangles.append((corners.reshape(-1, 3) + count).astype(np.uint32))
        count += len(used)
    scene = EmbreeScene()
    TriangleMesh(scene, np.concatenate(vertices), np.concatenate(triangles).astype(np.int32))
    return scene


def bare_batch(rays: U32) -> BareBatch:
    """Records uint32[n, 9] as embreex takes rays."""
    origins, directions = np.empty((len(rays), 3), np.float32), np.empty((len(rays), 3), np.float32)
    is_shadow = np.empty(len(rays), np.bool_)
    unpack_rays(rays, origins, directions, is_shadow, np.empty(3 * LANES, np.float32))
    shadows = int(is_shadow.sum())
    return BareBatch(origins[~is_shadow], directions[~is_shadow], origins[is_shadow], directions[is_shadow], np.ones(shadows, np.float32))


def cast_bare(scene: EmbreeScene, batches: list[BareBatch]) -> None:
    """Cast everything; answers are thrown away."""
    for batch in batches:
        if len(batch.path_origins):
            scene.run(batch.path_origins, batch.path_directions)
        if len(batch.shadow_origins):
            scene.run(batch.shadow_origins, batch.shadow_directions, batch.reaches, query="OCCLUDED")
