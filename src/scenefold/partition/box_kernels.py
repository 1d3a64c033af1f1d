"""What the families' tests of boxes against half-spaces share."""
# mypy: disallow-untyped-defs=False, disallow-untyped-calls=False, disallow-untyped-decorators=False

from __future__ import annotations

from numba import njit

ROUNDING = 2.0**-46
"""Sixty-four units in the last place: more than what the few operations of a test can lose together."""


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def least_along(nx, ny, nz, lx, ly, lz, hx, hy, hz):
    """The least n . p over the box: taken at one of its eight corners."""
    x = lx if nx > 0.0 else hx
    y = ly if ny > 0.0 else hy
    z = lz if nz > 0.0 else hz
    return nx * x + ny * y + nz * z


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def reach_along(nx, ny, nz, x, y, z):
    """A bound for |n . p| and for every sum on the way to it."""
    return abs(nx * x) + abs(ny * y) + abs(nz * z)
