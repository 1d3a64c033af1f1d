"""Many records cut into frames that are not too large, and lists that are begun anywhere. Pure functions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TypeVar

from scenefold.base.limits import CLIENT_FRAME_BYTES, CLIENT_FRAME_RECORDS

T = TypeVar("T")


def frames(
    indices: Sequence[int],
    sizes: Sequence[int] | Mapping[int, int],
    bytes_max: int = CLIENT_FRAME_BYTES,
    count_max: int = CLIENT_FRAME_RECORDS,
) -> Iterator[list[int]]:
    """Cut `indices` into runs whose sizes (by index) sum to at most `bytes_max`, and at least one record each."""
    frame: list[int] = []
    total = 0
    for index in indices:
        if frame and (total + sizes[index] > bytes_max or len(frame) >= count_max):
            yield frame
            frame, total = [], 0
        frame.append(index)
        total += sizes[index]
    if frame:
        yield frame


def turned(items: Sequence[T], chance: float) -> Sequence[T]:
    """The same, begun anywhere. `chance`: 0 <= x < 1."""
    start = int(chance * len(items))
    return [*items[start:], *items[:start]]
