"""How much of a texture a path stands for: squared footprints at hits, in the units of texture coordinates (specs/09, *Levels*). In lanes.

A hit has the footprint that a pixel's path would have there if the camera saw it, however the path came: so it follows from the
place, the scene and the job alone (after Pharr, Jakob and Humphreys, *Physically Based Rendering*, 4th edition, 10.1.2). It is round,
and as wide as the pixel across the view: along a slanting surface less is filtered than the pixel sees, and the paths do the rest.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from scenefold.render.arrays import MaterialColumn
from scenefold.render.lane_values_kernels import alike, any_lane, gather, select
from scenefold.render.normal_map_kernels import sides
from scenefold.render.space_kernels import longest_side
from scenefold.render.surface_kernels import turned

_TRANSMISSION = MaterialColumn.TRANSMISSION
_FORWARD, _KIND = 9, 14


@njit(error_model="numpy", _nrt=False, forceinline=True)
def squared_width(job, px, py, pz):  # type: ignore[no-untyped-def]
    """Of the footprint at points of the world, in world units; four lanes."""
    camera = job.camera
    if camera[_KIND] != 0.0:
        return alike(job.footprint, px)
    x, y, z = px - camera[0], py - camera[1], pz - camera[2]
    squared = x * x + y * y + z * z
    ahead = x * camera[_FORWARD] + y * camera[_FORWARD + 1] + z * camera[_FORWARD + 2]
    # A pixel's solid angle falls with the cube of this cosine; beside the image it stays as in its corner.
    cosine = max(ahead / math.sqrt(max(squared, 1e-30)), job.footprint_cosine)
    return squared * (cosine * cosine * cosine) * job.footprint


@njit(error_model="numpy", _nrt=False, forceinline=True)
def footprints_at(scene, job, material, triangle, instance, px, py, pz):  # type: ignore[no-untyped-def]
    """(of the first set of coordinates, of the second): squared footprints at hits, four lanes each; 0 where the finest level is to be read.

    That is so of materials that let light through: the caster's filter reads the finest level, and what is shaded makes up for what passed.
    """
    none = alike(0.0, px)
    if not job.footprint > 0.0:
        return none, none
    i0, i1, i2 = gather(scene.triangles, (triangle, 0)), gather(scene.triangles, (triangle, 1)), gather(scene.triangles, (triangle, 2))
    p = scene.vertices
    x0, y0, z0 = gather(p, (i0, 0)), gather(p, (i0, 1)), gather(p, (i0, 2))
    e1x, e1y, e1z = gather(p, (i1, 0)) - x0, gather(p, (i1, 1)) - y0, gather(p, (i1, 2)) - z0
    e2x, e2y, e2z = gather(p, (i2, 0)) - x0, gather(p, (i2, 1)) - y0, gather(p, (i2, 2)) - z0
    placed = instance != np.uint32(0)
    if any_lane(placed):
        qx, qy, qz = turned(scene.instance_matrices, instance, e1x, e1y, e1z)
        e1x, e1y, e1z = select(placed, qx, e1x), select(placed, qy, e1y), select(placed, qz, e1z)
        qx, qy, qz = turned(scene.instance_matrices, instance, e2x, e2y, e2z)
        e2x, e2y, e2z = select(placed, qx, e2x), select(placed, qy, e2y), select(placed, qz, e2z)
    # By the longest side, so that the areas of tiny and of huge triangles stay far from the ends of the range.
    size = 1.0 / max(longest_side(e1x, e1y, e1z, e2x, e2y, e2z), 1e-30)
    e1x, e1y, e1z, e2x, e2y, e2z = e1x * size, e1y * size, e1z * size, e2x * size, e2y * size, e2z * size
    gx, gy, gz = e1y * e2z - e1z * e2y, e1z * e2x - e1x * e2z, e1x * e2y - e1y * e2x
    area = math.sqrt(max(gx * gx + gy * gy + gz * gz, 1e-36))
    share = squared_width(job, px, py, pz) * size * size / area
    share = select(gather(scene.materials, (material, _TRANSMISSION)) > 0.0, 0.0, share)
    du1, dv1, du2, dv2 = sides(scene, scene.uvs, i0, i1, i2)
    first = abs(du1 * dv2 - du2 * dv1) * share
    second = first
    if scene.has_uvs2:
        du1, dv1, du2, dv2 = sides(scene, scene.uvs2, i0, i1, i2)
        second = abs(du1 * dv2 - du2 * dv1) * share
    return first, second
