"""A curve as an automaton: the tables that its compiled kernels walk (specs/02-curves.md).

Both curves cut a cube into 2^D halves along every axis, visit those in some order, and go on inside each.
One bit of every axis, axis 0 first, is a *symbol* (which child); its place in the order of visit is a
*digit*. A *state* says how the curve lies inside the present cube: Z-order has one, Hilbert D·2^(D-1).

    forward  [state, symbol] -> digit, next state        inverse [state, digit] -> symbol, next state

The Hilbert curve is C. Hamilton's formulation ("Compact Hilbert Indices", 2006) of Butz's curve: a state is
the corner where the curve enters (its set bits are even in number) and the axis d along which it leaves.
We chose it over Skilling's, whose axes get permuted in many more ways: these few states fit caches.

Kernels take several levels a step: then the symbol is D *chunks* of `levels` bits, one axis after the
other, so that no bits need interleaving, and the digit has D·levels bits. An entry is
`next state << width | digit`, width = D·levels, in 16 bits where it fits.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TypeVar

import numpy as np
import numpy.typing as npt

LEVELS_PER_STEP = {1: 8, 2: 4, 3: 3, 4: 2, 5: 1, 6: 1, 7: 1, 8: 1}
"""What keeps the tables of Hilbert in the first- or second-level cache: at most 24 KiB up to D = 6, 1 MiB at D = 8."""

Ints = npt.NDArray[np.int64]
Unsigned = TypeVar("Unsigned", bound=np.unsignedinteger)


@dataclass(frozen=True)
class Tables:
    """What one curve's kernels need. All arrays are read-only; entries are packed as the module says."""

    levels: int
    forward: npt.NDArray[np.unsignedinteger]
    """Of `levels` levels a step: chunks -> digits."""
    inverse: npt.NDArray[np.unsignedinteger]
    """Of `levels` levels a step: digits -> chunks."""
    forward_one: npt.NDArray[np.uint32]
    """Of one level: symbol -> digit."""
    inverse_one: npt.NDArray[np.uint32]
    """Of one level: digit -> symbol."""


@cache
def tables_of(kind: str, dimensions: int) -> Tables:
    """The tables of a curve; built once in a process, in milliseconds."""
    digit, following = _hilbert(dimensions) if kind == "hilbert" else _z_order(dimensions)
    levels = LEVELS_PER_STEP[dimensions]
    symbol, inverse_following = _inverted(digit, following)
    chunk_of_symbols = _interleavings(dimensions, levels)
    forward = _pack(*_several_levels(digit, following, levels, dimensions))
    inverse = _pack(*_several_levels(symbol, inverse_following, levels, dimensions))
    # Rows are by interleaved symbols; the kernels want them by concatenated chunks.
    width_mask = (1 << dimensions * levels) - 1
    by_chunks = np.empty_like(forward)
    by_chunks[:, chunk_of_symbols] = forward
    to_chunks = (inverse & ~np.int64(width_mask)) | chunk_of_symbols[inverse & width_mask]
    return Tables(
        levels,
        _compact(by_chunks),
        _compact(to_chunks),
        _frozen(_pack(digit, following).ravel().astype(np.uint32)),
        _frozen(_pack(symbol, inverse_following).ravel().astype(np.uint32)),
    )


def _z_order(dimensions: int) -> tuple[Ints, Ints]:
    symbols = np.arange(1 << dimensions, dtype=np.int64)[None, :]
    return symbols, np.zeros_like(symbols)


def _hilbert(dimensions: int) -> tuple[Ints, Ints]:
    """Digit and next state, both [state, symbol]; state = d << (D-1) | entry >> 1 (entry's parity is even)."""
    size = 1 << dimensions
    half_bits = dimensions - 1
    states = np.arange(dimensions << half_bits, dtype=np.int64)
    axis, upper = states >> half_bits, states & ((1 << half_bits) - 1)
    entry = (upper << 1) | (_bit_counts(upper) & 1)
    places = np.arange(size, dtype=np.int64)
    place_of_gray = np.empty(size, np.int64)
    place_of_gray[places ^ (places >> 1)] = places
    # Within a cube in standard position: where the child at a place is entered, and along which axis it is left.
    even_before = np.maximum(((places - 1) >> 1) << 1, 0)
    child_entry = even_before ^ (even_before >> 1)
    odd_of_pair = np.where(places & 1, places, np.maximum(places - 1, 0))
    child_axis = np.where(places == 0, 0, _trailing_ones(odd_of_pair)) % dimensions
    turns = (axis[:, None] + 1) % dimensions
    digit = place_of_gray[_rotated_left(places[None, :] ^ entry[:, None], -turns % dimensions, dimensions)]
    next_entry = entry[:, None] ^ _rotated_left(child_entry[digit], turns, dimensions)
    next_axis = (axis[:, None] + child_axis[digit] + 1) % dimensions
    return digit, (next_axis << half_bits) | (next_entry >> 1)


def _rotated_left(values: Ints, turns: Ints, width: int) -> Ints:
    return ((values << turns) | (values >> (width - turns))) & ((1 << width) - 1)


def _bit_counts(values: Ints) -> Ints:
    return np.bitwise_count(values).astype(np.int64)


def _trailing_ones(values: Ints) -> Ints:
    return _bit_counts(values & ~(values + 1))


def _inverted(digit: Ints, following: Ints) -> tuple[Ints, Ints]:
    symbol = np.argsort(digit, axis=1)
    return symbol, np.take_along_axis(following, symbol, axis=1)


def _several_levels(output: Ints, following: Ints, levels: int, dimensions: int) -> tuple[Ints, Ints]:
    """The same automaton reading `levels` inputs at once, the first in the highest bits."""
    inputs = np.arange(1 << dimensions * levels, dtype=np.int64)[None, :]
    state = np.broadcast_to(np.arange(len(output), dtype=np.int64)[:, None], (len(output), inputs.size))
    outputs = np.zeros_like(state)
    for level in reversed(range(levels)):
        one = (inputs >> dimensions * level) & ((1 << dimensions) - 1)
        outputs = (outputs << dimensions) | output[state, one]
        state = following[state, one]
    return outputs, state


def _interleavings(dimensions: int, levels: int) -> Ints:
    """For a row of symbols, highest level first: the same bits as chunks, axis 0 first."""
    symbols = np.arange(1 << dimensions * levels, dtype=np.int64)
    chunks = np.zeros_like(symbols)
    for axis in range(dimensions):
        for level in range(levels):
            bit = (symbols >> (level * dimensions + dimensions - 1 - axis)) & 1
            chunks |= bit << ((dimensions - 1 - axis) * levels + level)
    return chunks


def _pack(output: Ints, following: Ints) -> Ints:
    width = (output.shape[1] - 1).bit_length()
    packed: Ints = (following << width) | output
    return packed


def _compact(table: Ints) -> npt.NDArray[np.unsignedinteger]:
    narrow = np.uint16 if int(table.max()) < 1 << 16 else np.uint32
    return _frozen(table.ravel().astype(narrow))


def _frozen(table: npt.NDArray[Unsigned]) -> npt.NDArray[Unsigned]:
    table.setflags(write=False)
    return table
