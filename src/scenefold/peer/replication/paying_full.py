"""How a holder without room is asked whether it has some again: by little, and ever more seldom (specs/20-copies.md, Full disks).

A full disk takes what makes room there, or takes no more than what it replaces, and nobody but its node can tell which records these are. So what
is owed is offered on as long as any of it is taken, and each try goes on where the last one ended.
"""

from __future__ import annotations

from collections.abc import Sequence

from scenefold.base.reasons import RejectReason
from scenefold.peer.replication.full_holders import AGAIN_S_MAX, AGAIN_S_MIN

WASTED_BYTES_MAX = 64 * 1024
"""Offered in vain at a time: one record of the largest, or some hundred small ones."""


class FullDisk:
    """Of one holder. Pure."""

    def __init__(self) -> None:
        self._pause_s = 0.0
        self._wasted_bytes = 0
        self._is_full = False
        self.has_refused = False
        """Whether anything had no room since this try began."""

    @property
    def is_hopeless(self) -> bool:
        """Whether enough was offered in vain."""
        return self._wasted_bytes >= WASTED_BYTES_MAX

    def begin(self) -> None:
        """What is owed is offered once more."""
        self.has_refused, self._wasted_bytes = False, 0

    def packet_bytes(self, most: int) -> int:
        """How much is offered at once, where `most` could be."""
        return min(most, WASTED_BYTES_MAX) if self._is_full else most

    def answered(self, sizes: Sequence[int], reasons: Sequence[int]) -> None:
        """What became of records of so many bytes each."""
        refused_bytes = sum(size for size, reason in zip(sizes, reasons, strict=True) if reason == RejectReason.STORAGE_FULL)
        if 0 in reasons:
            self._pause_s, self._wasted_bytes, self._is_full = 0.0, 0, False
        if refused_bytes:
            self.has_refused = self._is_full = True
            self._wasted_bytes += refused_bytes

    def next_pause_s(self) -> float:
        """Until it is tried again: the least if it has just taken anything, else twice as long as before."""
        self._pause_s = min(AGAIN_S_MAX, max(AGAIN_S_MIN, 2 * self._pause_s))
        return self._pause_s
