"""How far one may go within a convex hull, compiled (thesis 3.2.2, the hull rule; specs/28-rebalancing.md, Hull).

s v lies in the hull of 0 and the ways e_1 .. e_m up to s = 1 / the least sum of numbers >= 0 that make v out of the e: a linear program with three rows, whose solution stands on three of the e at most. All threes are looked at,
and all pairs and single ones, so that ways in one line or plane are no special case.
"""
# mypy: disallow-untyped-defs=False, disallow-untyped-calls=False, disallow-untyped-decorators=False

from __future__ import annotations

import math

from numba import njit

FLAT = 1e-12
"""Three unit vectors that span less than this lie in a plane, two in a line."""
NEAR = 1e-9
"""How far from a plane or line of ways v may be, of its own length, and still lie in it."""


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def _triple(a, b, c):
    return a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0])


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def _pair_sum(a, b, v):
    """x + y of x a + y b = v with x, y >= 0; inf if there are none."""
    aa, ab, bb, av, bv, vv = _dot(a, a), _dot(a, b), _dot(b, b), _dot(a, v), _dot(b, v), _dot(v, v)
    det = aa * bb - ab * ab
    if det <= FLAT * aa * bb:
        return math.inf
    x, y = (av * bb - bv * ab) / det, (bv * aa - av * ab) / det
    if x < 0.0 or y < 0.0:
        return math.inf
    rx, ry, rz = v[0] - x * a[0] - y * b[0], v[1] - x * a[1] - y * b[1], v[2] - x * a[2] - y * b[2]
    return x + y if rx * rx + ry * ry + rz * rz <= NEAR * NEAR * vv else math.inf


@njit(nogil=True, cache=True, error_model="numpy", _nrt=False)
def reach(ways, v):
    """The greatest s <= 1 with s v in the hull of 0 and the rows of `ways` f64[m, 3]: f64; 1 for v = 0."""
    length = _dot(v, v)
    if length == 0.0:
        return 1.0
    least = math.inf
    for i in range(ways.shape[0]):
        a = ways[i]
        aa, av = _dot(a, a), _dot(a, v)
        if aa == 0.0:
            continue
        x = av / aa
        rx, ry, rz = v[0] - x * a[0], v[1] - x * a[1], v[2] - x * a[2]
        if av > 0.0 and rx * rx + ry * ry + rz * rz <= NEAR * NEAR * length:
            least = min(least, x)
        for j in range(i):
            b = ways[j]
            bb = _dot(b, b)
            if bb == 0.0:
                continue
            least = min(least, _pair_sum(a, b, v))
            for k in range(j):
                c = ways[k]
                volume = _triple(a, b, c)
                if abs(volume) <= FLAT * math.sqrt(aa * bb * _dot(c, c)):
                    continue
                x, y, z = _triple(v, b, c) / volume, _triple(a, v, c) / volume, _triple(a, b, v) / volume
                if x >= 0.0 and y >= 0.0 and z >= 0.0:
                    least = min(least, x + y + z)
    return min(1.0, 1.0 / least)
