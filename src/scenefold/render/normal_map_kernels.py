"""Normal maps: the shading normal that a texture tilts out of the surface's own (specs/09-renderer-contract.md). In lanes.

glTF's frame: the tangent runs along u, the bitangent against v, for v runs down the image. A mesh's own tangents count where there are
any; else they follow from how the texture's coordinates, after its transform, lie over the triangle.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from scenefold.render.arrays import TextureUseColumn
from scenefold.render.lane_values_kernels import any_lane, gather, select, whole_of_real
from scenefold.render.surface_kernels import blend, texture_of, turned

_UV_SET = TextureUseColumn.UV_SET
_M00, _M01, _M10, _M11 = TextureUseColumn.M00, TextureUseColumn.M01, TextureUseColumn.M10, TextureUseColumn.M11
_HIDDEN = 1e-4


@njit(error_model="numpy", _nrt=False, forceinline=True)
def sides(scene, uvs, i0, i1, i2):  # type: ignore[no-untyped-def]
    """What coordinates gain along two sides of a triangle: du1, dv1, du2, dv2."""
    u0, v0 = gather(uvs, (i0, 0)), gather(uvs, (i0, 1))
    return gather(uvs, (i1, 0)) - u0, gather(uvs, (i1, 1)) - v0, gather(uvs, (i2, 0)) - u0, gather(uvs, (i2, 1)) - v0


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _unit(x, y, z):  # type: ignore[no-untyped-def]
    """(unit vector, whether there is one), of vectors of any size."""
    size = max(abs(x), max(abs(y), abs(z)))
    some = size > 1e-30
    scale = 1.0 / select(some, size, 1.0)
    x, y, z = x * scale, y * scale, z * scale
    scale = 1.0 / math.sqrt(max(x * x + y * y + z * z, 1e-12))
    return x * scale, y * scale, z * scale, some


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _tangent(scene, use, triangle, u, v):  # type: ignore[no-untyped-def]
    """(tangent in the prototype's space, of any length; sign of the bitangent, against normal x tangent)."""
    i0, i1, i2 = gather(scene.triangles, (triangle, 0)), gather(scene.triangles, (triangle, 1)), gather(scene.triangles, (triangle, 2))
    uses = scene.texture_uses
    du1, dv1, du2, dv2 = sides(scene, scene.uvs, i0, i1, i2)
    if scene.has_uvs2:
        second = gather(uses, (use, _UV_SET)) != 0.0
        eu1, ev1, eu2, ev2 = sides(scene, scene.uvs2, i0, i1, i2)
        du1, dv1, du2, dv2 = select(second, eu1, du1), select(second, ev1, dv1), select(second, eu2, du2), select(second, ev2, dv2)
    m00, m01, m10, m11 = gather(uses, (use, _M00)), gather(uses, (use, _M01)), gather(uses, (use, _M10)), gather(uses, (use, _M11))
    du1, dv1, du2, dv2 = m00 * du1 + m01 * dv1, m10 * du1 + m11 * dv1, m00 * du2 + m01 * dv2, m10 * du2 + m11 * dv2
    p = scene.vertices
    x0, y0, z0 = gather(p, (i0, 0)), gather(p, (i0, 1)), gather(p, (i0, 2))
    e1x, e1y, e1z = gather(p, (i1, 0)) - x0, gather(p, (i1, 1)) - y0, gather(p, (i1, 2)) - z0
    e2x, e2y, e2z = gather(p, (i2, 0)) - x0, gather(p, (i2, 1)) - y0, gather(p, (i2, 2)) - z0
    turn = select(du1 * dv2 - du2 * dv1 < 0.0, -1.0, 1.0)
    tx, ty, tz = (e1x * dv2 - e2x * dv1) * turn, (e1y * dv2 - e2y * dv1) * turn, (e1z * dv2 - e2z * dv1) * turn
    sign = -turn
    if scene.has_tangents:
        w, t = 1.0 - u - v, scene.tangents
        gx, gy, gz = blend(w, u, v, t, i0, i1, i2, 0), blend(w, u, v, t, i0, i1, i2, 1), blend(w, u, v, t, i0, i1, i2, 2)
        given = gx * gx + gy * gy + gz * gz > 1e-6
        tx, ty, tz = select(given, gx, tx), select(given, gy, ty), select(given, gz, tz)
        sign = select(given, gather(t, (i0, 3)), sign)
    return tx, ty, tz, sign


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _tilted(scene, material, triangle, instance, u, v, places, nx, ny, nz, scratch, use_column, scale_column):  # type: ignore[no-untyped-def]
    """The unit normal (world) that the texture of a column makes of the unit shading normal n; n where there is no texture.

    places: as in `texture_of`; n looks to where corners are seen counter-clockwise. A texel is a vector of the frame
    (tangent, bitangent, n).
    """
    named = gather(scene.materials, (material, use_column))
    has = named >= 0.0
    if not any_lane(has):
        return nx, ny, nz
    r, g, b, _ = texture_of(scene, material, use_column, places, scratch)
    scale = gather(scene.materials, (material, scale_column))
    x, y, z = (2.0 * r - 1.0) * scale, (2.0 * g - 1.0) * scale, 2.0 * b - 1.0
    tx, ty, tz, sign = _tangent(scene, whole_of_real(select(has, named, 0.0)), triangle, u, v)
    placed = instance != np.uint32(0)
    if any_lane(placed):
        m = scene.instance_matrices
        qx, qy, qz = turned(m, instance, tx, ty, tz)
        tx, ty, tz = select(placed, qx, tx), select(placed, qy, ty), select(placed, qz, tz)
        ax, ay, az = gather(m, (instance, 0, 0)), gather(m, (instance, 1, 0)), gather(m, (instance, 2, 0))
        bx, by, bz = gather(m, (instance, 0, 1)), gather(m, (instance, 1, 1)), gather(m, (instance, 2, 1))
        cx, cy, cz = gather(m, (instance, 0, 2)), gather(m, (instance, 1, 2)), gather(m, (instance, 2, 2))
        mirrored = (ay * bz - az * by) * cx + (az * bx - ax * bz) * cy + (ax * by - ay * bx) * cz < 0.0
        sign = select(placed & mirrored, -sign, sign)
    tx, ty, tz, some = _unit(tx, ty, tz)
    along_n = tx * nx + ty * ny + tz * nz
    tx, ty, tz, level = _unit(tx - along_n * nx, ty - along_n * ny, tz - along_n * nz)
    bx, by, bz = sign * (ny * tz - nz * ty), sign * (nz * tx - nx * tz), sign * (nx * ty - ny * tx)
    wx, wy, wz, found = _unit(x * tx + y * bx + z * nx, x * ty + y * by + z * ny, x * tz + y * bz + z * nz)
    has = has & some & level & found
    return select(has, wx, nx), select(has, wy, ny), select(has, wz, nz)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def mapped_normal(scene, material, triangle, instance, u, v, places, n, g, d, away, scratch, use_column, scale_column):  # type: ignore[no-untyped-def]
    """The normal to shade with, on the viewer's side: tilted, unless it would look away from the viewer or into the surface.

    n, g: unit shading and geometric normals on the viewer's side; d: where the ray goes; away: whether that is the back, so that both
    stand against the winding.
    """
    side = select(away, -1.0, 1.0)
    wx, wy, wz = _tilted(
        scene, material, triangle, instance, u, v, places, n[0] * side, n[1] * side, n[2] * side, scratch, use_column, scale_column,
    )  # fmt: skip
    wx, wy, wz = wx * side, wy * side, wz * side
    shown = (d[0] * wx + d[1] * wy + d[2] * wz < -_HIDDEN) & (wx * g[0] + wy * g[1] + wz * g[2] > _HIDDEN)
    return select(shown, wx, n[0]), select(shown, wy, n[1]), select(shown, wz, n[2])
