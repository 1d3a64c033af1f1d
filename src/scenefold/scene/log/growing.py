"""Rows that grow at their end, of which every earlier one stays as it was: what a log adds to a space, say.

A tuple would be copied whole for each new item, and a log of many steps would fold in time that goes with their square. Here a row is a
tuple of chunks, each a power of two long and shorter than the one before, as in a binary number: an item is copied once for each doubling.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain
from typing import TypeAlias, TypeVar

Item = TypeVar("Item")
Row: TypeAlias = tuple[tuple[Item, ...], ...]
"""Rows of equal items are equal: their number alone says how they are cut."""


def grown(row: Row[Item], item: Item) -> Row[Item]:
    """The row with one more item."""
    end: tuple[Item, ...] = (item,)
    while row and len(row[-1]) == len(end):
        row, end = row[:-1], row[-1] + end
    return (*row, end)


def row_of(items: Sequence[Item]) -> Row[Item]:
    """The row that these items make, one after the other."""
    chunks, start = [], 0
    for bit in reversed(range(len(items).bit_length())):
        if len(items) >> bit & 1:
            chunks.append(tuple(items[start : start + (1 << bit)]))
            start += 1 << bit
    return tuple(chunks)


def items_of(row: Row[Item]) -> Iterator[Item]:
    """All items, from the first on."""
    return chain.from_iterable(row)
