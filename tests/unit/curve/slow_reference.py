"""The curves once more, slowly and in another way: with lists of axes and whole numbers of any size.

The product walks tables of corners and rotations. Here a curve is drawn as geometry: a cube lies as a signed
permutation of axes says, and the law of Hilbert's curve gives each child its own. Nothing is shared with src/.
"""

from __future__ import annotations

import itertools

LOCATION_BITS = 160


def axis_bits(dimensions: int) -> int:
    return LOCATION_BITS // dimensions


def cell_bits(dimensions: int) -> int:
    return min(64, axis_bits(dimensions))


class Frame:
    """How a cube's curve lies: local axis i is world axis axes[i], mirrored if flips[i].

    In its own frame the curve enters at the corner (0, ..., 0) and leaves along local axis 0.
    Local axis i is the i-th to change in Gray order, counted from the bit that changes most often.
    """

    def __init__(self, axes: list[int], flips: list[bool]) -> None:
        self.axes, self.flips = axes, flips

    def to_world(self, local: list[int]) -> list[int]:
        world = [0] * len(local)
        for bit, axis, flip in zip(local, self.axes, self.flips, strict=True):
            world[axis] = bit ^ flip
        return world

    def child(self, place: int) -> Frame:
        """The frame of the child at this place in the order of visit."""
        count = len(self.axes)
        entry, along = entry_and_axis(place, count)
        turned = [(i + along + 1) % count for i in range(count)]
        return Frame([self.axes[i] for i in turned], [self.flips[i] ^ bool(entry[i]) for i in turned])


def gray(place: int, count: int) -> list[int]:
    """Place in Gray order as bits, the most often changing one first."""
    code = place ^ (place >> 1)
    return [(code >> i) & 1 for i in range(count)]


def changed_axis(place: int, count: int) -> int:
    """Which bit changes from a place to the next."""
    before, after = gray(place, count), gray(place + 1, count)
    return next(i for i in range(count) if before[i] != after[i])


def entry_and_axis(place: int, count: int) -> tuple[list[int], int]:
    """Of a child: its entry corner, and the axis that its curve leaves along (specs/02-curves.md)."""
    if place == 0:
        return [0] * count, 0
    entry = gray((place - 1) // 2 * 2, count)
    if place == (1 << count) - 1:
        return entry, 0  # the order of visit read backwards is the same order, mirrored: as at place 0
    return entry, changed_axis(place - 1 if place % 2 == 0 else place, count) % count


def first_frame(kind: str, dimensions: int) -> Frame:
    """At the top: local axis i is bit i + 1 (cyclically) of the symbol, whose highest bit is axis 0."""
    del kind
    return Frame([dimensions - 1 - (i + 1) % dimensions for i in range(dimensions)], [False] * dimensions)


def index_of(kind: str, cell: list[int], bits: int) -> int:
    """Curve index of a cell with `bits` bits an axis."""
    count, index, frame = len(cell), 0, first_frame(kind, len(cell))
    for level in reversed(range(bits)):
        symbol = [(number >> level) & 1 for number in cell]
        if kind == "z-order":
            place = int("".join(map(str, symbol)), 2)
        else:
            place = next(p for p in range(1 << count) if frame.to_world(gray(p, count)) == symbol)
            frame = frame.child(place)
        index = (index << count) | place
    return index


def cell_of(kind: str, index: int, dimensions: int, bits: int) -> list[int]:
    """Cell at a curve index."""
    cell, frame = [0] * dimensions, first_frame(kind, dimensions)
    for level in reversed(range(bits)):
        place = (index >> (dimensions * level)) & ((1 << dimensions) - 1)
        if kind == "z-order":
            symbol = [(place >> (dimensions - 1 - axis)) & 1 for axis in range(dimensions)]
        else:
            symbol = frame.to_world(gray(place, dimensions))
            frame = frame.child(place)
        cell = [(number << 1) | bit for number, bit in zip(cell, symbol, strict=True)]
    return cell


def location_of(kind: str, cell: list[int]) -> bytes:
    """The location of a cell, 20 bytes."""
    count = len(cell)
    bits = axis_bits(count)
    index = index_of(kind, [number << (bits - cell_bits(count)) for number in cell], bits)
    return (index << (LOCATION_BITS - count * bits)).to_bytes(20, "big")


def cell_at(kind: str, location: bytes, dimensions: int) -> list[int]:
    """The cell that holds a location."""
    bits = axis_bits(dimensions)
    index = int.from_bytes(location, "big") >> (LOCATION_BITS - dimensions * bits)
    return [number >> (bits - cell_bits(dimensions)) for number in cell_of(kind, index, dimensions, bits)]


def runs_of(indexes: list[int]) -> list[tuple[int, int]]:
    """Ascending runs of consecutive numbers."""
    runs: list[list[int]] = []
    for index in sorted(indexes):
        if runs and index == runs[-1][1] + 1:
            runs[-1][1] = index
        else:
            runs.append([index, index])
    return [(first, last) for first, last in runs]


def best_cover_length(indexes: list[int], limit: int) -> int:
    """How many indexes the best cover by `limit` runs has: all but the longest gaps."""
    runs = runs_of(indexes)
    gaps = sorted((after[0] - before[1] - 1 for before, after in itertools.pairwise(runs)), reverse=True)
    return runs[-1][1] - runs[0][0] + 1 - sum(gaps[: limit - 1])
