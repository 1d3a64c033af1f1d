"""What a rough boundary of glass gives on after one bounce on its facets, read from a table (glass_albedo.py). In lanes, or numbers."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from scenefold.render.glass_albedo import COSINES, INDICES, ROUGHNESSES, TABLE
from scenefold.render.lane_values_kernels import gather, real_of_whole, rounded_down, select, whole_of_real

_TABLE = TABLE
_PLANE, _ROW, _ONE, _LOWER, _UPPER = np.uint32(COSINES * INDICES), np.uint32(INDICES), np.uint32(1), np.uint32(0xFFFF), np.uint32(16)
_STEPS = float(ROUGHNESSES - 1), float(COSINES - 1), float(INDICES - 1)
_UNIT, _LEAST = 1.0 / 65535.0, 1.0 / 64.0


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _between(place, steps):  # type: ignore[no-untyped-def]
    """(the lower node, how far it is to the next one) of a place from 0 to 1 among so many steps."""
    at = min(max(place, 0.0), 1.0) * steps
    low = min(rounded_down(at), steps - 1.0)
    return whole_of_real(low), at - low


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _read(within, place):  # type: ignore[no-untyped-def]
    word = gather(_TABLE, (place,))
    return real_of_whole(select(within, word >> _UPPER, word & _LOWER))


@njit(error_model="numpy", _nrt=False, forceinline=True)
def _read_pair(within, place, part):  # type: ignore[no-untyped-def]
    return _read(within, place) * (1.0 - part) + _read(within, place + _ONE) * part


@njit(error_model="numpy", _nrt=False, forceinline=True)
def kept_by_glass(alpha, cosine, index, within):  # type: ignore[no-untyped-def]
    """The share of the light from a cosine that one bounce mirrors and bends, 1/64 to 1. index: of the glass, 1 at least; within: seen from inside."""
    plane, up = _between(math.sqrt(alpha), _STEPS[0])
    row, right = _between(math.sqrt(max(cosine, 0.0)), _STEPS[1])
    at, part = _between(math.sqrt((index - 1.0) / (index + 1.0)), _STEPS[2])
    place = plane * _PLANE + row * _ROW + at
    lower = _read_pair(within, place, part) * (1.0 - right) + _read_pair(within, place + _ROW, part) * right
    place = place + _PLANE
    upper = _read_pair(within, place, part) * (1.0 - right) + _read_pair(within, place + _ROW, part) * right
    return max((lower * (1.0 - up) + upper * up) * _UNIT, _LEAST)
