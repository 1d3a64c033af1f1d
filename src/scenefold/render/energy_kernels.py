"""What a single bounce on GGX gives back and loses, read from a table, and what several bounces make of the loss. In lanes, or numbers.

The lobe of further bounces is Kulla's and Conty's: (1 - E(o)) (1 - E(i)) / (pi (1 - Eavg)), reciprocal, and with the single bounce it
gives back everything where nothing is absorbed (ggx_albedo.py).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from scenefold.render.ggx_albedo import AVERAGES, NODES, TABLE
from scenefold.render.lane_values_kernels import gather, real_of_whole, rounded_down, whole_of_real

_TABLE, _AVERAGES = TABLE, AVERAGES
_STEPS, _LAST = float(NODES - 1), float(NODES - 2)
_ROW, _ONE, _LOWER, _UPPER = np.uint32(NODES), np.uint32(1), np.uint32(0xFFFF), np.uint32(16)
_UNIT = 1.0 / 65535.0
_LEAST = 1e-9


class Rough(NamedTuple):
    """A roughness, as the table has it."""

    row: Any
    """Where the lower of two rows begins."""
    part: Any
    """How far it is to the next one, 0 to 1."""
    missing: Any
    """1 - Eavg"""
    grazing: Any
    """Bavg"""


@njit(error_model="numpy", _nrt=False, forceinline=True)
def rough_of(alpha):  # type: ignore[no-untyped-def]
    """Of GGX's alpha, 1e-3 to 1."""
    at = math.sqrt(min(alpha, 1.0)) * _STEPS
    low = min(rounded_down(at), _LAST)
    part, row = at - low, whole_of_real(low)
    rest = 1.0 - part
    missing = rest * gather(_AVERAGES, (row, 0)) + part * gather(_AVERAGES, (row + _ONE, 0))
    grazing = rest * gather(_AVERAGES, (row, 1)) + part * gather(_AVERAGES, (row + _ONE, 1))
    return Rough(row * _ROW, part, max(missing, _LEAST), grazing)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def albedo_of(rough, cosine):  # type: ignore[no-untyped-def]
    """(1 - E, B) towards a cosine, which counts as 0 below it: what a Fresnel term of 1 loses, what one of (1 - V.H)^5 gives back."""
    at = math.sqrt(min(max(cosine, 0.0), 1.0)) * _STEPS
    low = min(rounded_down(at), _LAST)
    right, place = at - low, rough.row + whole_of_real(low)
    left, lower, upper = 1.0 - right, (1.0 - rough.part) * _UNIT, rough.part * _UNIT
    a, b = gather(_TABLE, (place,)), gather(_TABLE, (place + _ONE,))
    c, d = gather(_TABLE, (place + _ROW,)), gather(_TABLE, (place + _ROW + _ONE,))
    missing = (
        lower * (left * real_of_whole(a & _LOWER) + right * real_of_whole(b & _LOWER))
        + upper * (left * real_of_whole(c & _LOWER) + right * real_of_whole(d & _LOWER))
    )  # fmt: skip
    grazing = (
        lower * (left * real_of_whole(a >> _UPPER) + right * real_of_whole(b >> _UPPER))
        + upper * (left * real_of_whole(c >> _UPPER) + right * real_of_whole(d >> _UPPER))
    )  # fmt: skip
    return missing, grazing


@njit(error_model="numpy", _nrt=False, forceinline=True)
def bounced(f0, f90, rough):  # type: ignore[no-untyped-def]
    """The share of what a single bounce loses that comes out after more of them, by Schlick's term: 1 where f0 = f90 = 1."""
    mean = f0 + (f90 - f0) * (1.0 / 21.0)
    return mean * mean * (1.0 - rough.missing) / (1.0 - mean * rough.missing)


@njit(error_model="numpy", _nrt=False, forceinline=True)
def left_of(f0, f90, more, missing, grazing):  # type: ignore[no-untyped-def]
    """1 - the albedo of all bounces: what a layer with this Schlick term leaves to what lies below. `more`: of `bounced`."""
    return max(1.0 - f0 * (1.0 - missing - grazing) - f90 * grazing - more * missing, 0.0)
