"""What the inside of a solid body leaves of light (KHR_materials_volume; specs/09-renderer-contract.md, *Glass*). In lanes, or numbers."""

from __future__ import annotations

import math

from numba import njit

from scenefold.render.arrays import MaterialColumn
from scenefold.render.lane_values_kernels import gather, select
from scenefold.render.math_kernels import exp2_in_lanes, log2_in_lanes

_DISTANCE, _COLOR = MaterialColumn.ATTENUATION_DISTANCE, MaterialColumn.ATTENUATION_COLOR
_LOWEST = -126.0
"""The least power of two that is told from nothing."""
_COLOR_MIN = 2.0**-126


@njit(error_model="numpy", _nrt=False, forceinline=True)
def left_after(color, ways):  # type: ignore[no-untyped-def]
    """color^ways: of one channel, after so many attenuation distances. Nothing where the colour is 0, all where it is 1."""
    power = exp2_in_lanes(max(_LOWEST, min(0.0, ways * log2_in_lanes(max(color, _COLOR_MIN)))))
    return select(color >= 1.0, 1.0, select(color > 0.0, power, 0.0))


@njit(error_model="numpy", _nrt=False, forceinline=True)
def absorbed(scene, material, squared):  # type: ignore[no-untyped-def]
    """(red, green, blue) that are left after the way whose square is given, through the inside of each lane's material."""
    rows = scene.materials
    ways = math.sqrt(squared) / gather(rows, (material, _DISTANCE))
    return (
        left_after(gather(rows, (material, _COLOR)), ways),
        left_after(gather(rows, (material, _COLOR + 1)), ways),
        left_after(gather(rows, (material, _COLOR + 2)), ways),
    )
