"""Cells to locations and back, compiled: one walk down a curve's automaton per point (specs/02-curves.md).

A location is built in three words, `high` and `middle` of 64 bits and `low`, whose upper 32 bits count:

    bit of the location  0        64       128   160
                         |  high  | middle | low |  (spare)

Dimensions and levels a step come as tuples of that length, so that numba compiles one kernel for each pair,
with all loops over them unrolled: twice as fast as one kernel for all. Compiled code is cached on disk.
"""

from __future__ import annotations

import numpy as np
from numba import njit

ONE = np.uint64(1)
WORD = np.uint64(64)
TWO_WORDS = np.uint64(128)
THREE_WORDS = np.uint64(192)
ALL = np.uint64(0xFFFFFFFFFFFFFFFF)
BYTE = np.uint64(8)


@njit(nogil=True, cache=True)
def encode(cells, table, by_dimension, by_level, out):
    """Write the locations of `cells` (uint64[n, D], in range) to `out` (uint8[n, 20])."""
    dimensions = len(by_dimension)
    levels = len(by_level)
    width = np.uint64(dimensions * levels)
    all_levels = 160 // dimensions
    cell_levels = min(all_levels, 64)
    steps = (all_levels + levels - 1) // levels
    cell_steps = (cell_levels + levels - 1) // levels
    pad = np.uint64(cell_steps * levels - cell_levels)
    digit_mask = (ONE << width) - ONE
    chunk_mask = (ONE << np.uint64(levels)) - ONE
    spare_mask = ~((ONE << np.uint64(192 - dimensions * all_levels)) - ONE)
    for point in range(cells.shape[0]):
        high = np.uint64(0)
        middle = np.uint64(0)
        low = np.uint64(0)
        state = np.uint64(0)
        end = np.uint64(0)
        for step in range(steps):
            entry = state
            if step < cell_steps:
                shift = np.uint64((cell_steps - 1 - step) * levels)
                chunks = np.uint64(0)
                for axis in range(dimensions):
                    # The last step of 53 levels, three a step, reads one zero bit behind the cell's last.
                    chunks = (chunks << np.uint64(levels)) | (((cells[point, axis] << pad) >> shift) & chunk_mask)
                entry = state | chunks
            found = np.uint64(table[entry])
            state = found & ~digit_mask
            digit = found & digit_mask
            start = end
            end = start + width
            if end <= WORD:
                high |= digit << (WORD - end)
            elif end <= TWO_WORDS:
                middle |= digit << (TWO_WORDS - end)
                if start < WORD:
                    high |= digit >> (end - WORD)
            else:
                low |= digit << (THREE_WORDS - end)
                if start < TWO_WORDS:
                    middle |= digit >> (end - TWO_WORDS)
        low &= spare_mask
        for byte in range(8):
            shift = np.uint64(56 - 8 * byte)
            out[point, byte] = np.uint8((high >> shift) & np.uint64(255))
            out[point, byte + 8] = np.uint8((middle >> shift) & np.uint64(255))
        for byte in range(4):
            out[point, byte + 16] = np.uint8((low >> np.uint64(56 - 8 * byte)) & np.uint64(255))


@njit(nogil=True, cache=True)
def decode(locations, table, by_dimension, by_level, out):
    """Write the cells that hold `locations` (uint8[n, 20]) to `out` (uint64[n, D])."""
    dimensions = len(by_dimension)
    levels = len(by_level)
    width = np.uint64(dimensions * levels)
    cell_levels = min(160 // dimensions, 64)
    cell_steps = (cell_levels + levels - 1) // levels
    pad = np.uint64(cell_steps * levels - cell_levels)
    digit_mask = (ONE << width) - ONE
    chunk_mask = (ONE << np.uint64(levels)) - ONE
    for point in range(locations.shape[0]):
        high = np.uint64(0)
        middle = np.uint64(0)
        low = np.uint64(0)
        for byte in range(8):
            high = (high << BYTE) | np.uint64(locations[point, byte])
            middle = (middle << BYTE) | np.uint64(locations[point, byte + 8])
        for byte in range(4):
            low = (low << BYTE) | np.uint64(locations[point, byte + 16])
        low <<= np.uint64(32)
        for axis in range(dimensions):
            out[point, axis] = np.uint64(0)
        state = np.uint64(0)
        end = np.uint64(0)
        for _ in range(cell_steps):
            start = end
            end = start + width
            if end <= WORD:
                digit = high >> (WORD - end)
            elif end <= TWO_WORDS:
                digit = middle >> (TWO_WORDS - end)
                if start < WORD:
                    digit |= high << (end - WORD)
            else:
                digit = low >> (THREE_WORDS - end)
                if start < TWO_WORDS:
                    digit |= middle << (end - TWO_WORDS)
            found = np.uint64(table[state | (digit & digit_mask)])
            state = found & ~digit_mask
            for axis in range(dimensions):
                chunk = (found >> np.uint64((dimensions - 1 - axis) * levels)) & chunk_mask
                out[point, axis] = (out[point, axis] << np.uint64(levels)) | chunk
        for axis in range(dimensions):
            out[point, axis] >>= pad
