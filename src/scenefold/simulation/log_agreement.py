"""What lies on all disks, and was shown to anybody, is one log (specs/17-simulation.md, Logs). Pure.

Fed with every value as it is decided somewhere, in the order in which that is seen. A law that does not hold is said once for each
place where it does not.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

from scenefold.simulation import laws
from scenefold.simulation.log_history import Request, Wrong


class Entry(NamedTuple):
    """A value as it was decided at a position. `digest`: of all that it says; `previous`: of the one before, empty if it does not say; `request`: likewise."""

    position: int
    digest: bytes
    request: Request = b""
    previous: bytes = b""

    def __str__(self) -> str:
        return f"{self.digest.hex()[:8]} at position {self.position}"


class Agreement:
    """The one log, as far as anybody has shown any of it."""

    def __init__(self) -> None:
        self._entries: dict[int, Entry] = {}
        self._at: dict[Request, int] = {}
        self._ends: dict[str, int] = {}

    @property
    def entries(self) -> Mapping[int, Entry]:
        return self._entries

    @property
    def at(self) -> Mapping[Request, int]:
        """Where each request was decided, as far as that is known."""
        return self._at

    @property
    def newest(self) -> int:
        return max(self._entries, default=0)

    def shown(self, where: str, entry: Entry) -> list[Wrong]:
        """Somebody has this as decided, or was shown it."""
        known = self._entries.get(entry.position)
        if known is None:
            self._entries[entry.position] = known = entry
            return [*self._misfits(where, entry), *self.requested(entry.request, entry.position)]
        if known.digest != entry.digest:
            return [Wrong(laws.ONE_VALUE, f"{where} has {entry}, where {known.digest.hex()[:8]} is decided already")]
        return []

    def requested(self, request: Request, position: int) -> list[Wrong]:
        """A request is decided at a position, as whoever can read the log says."""
        if not request:
            return []
        known = self._at.setdefault(request, position)
        if known == position:
            return []
        return [Wrong(laws.ONCE, f"request {request.hex()[:8]} is in the log twice, at {known} and {position}")]

    def holds(self, where: str, end: int) -> list[Wrong]:
        """A disk's newest position is this."""
        before = self._ends.get(where, 0)
        self._ends[where] = max(before, end)
        return [Wrong(laws.ENTRIES_STAY, f"{where} had position {before}, and has {end} now")] if end < before else []

    def extends(self, where: str, position: int, shown: int = 0) -> list[Wrong]:
        """A disk has, or has anew, what is decided at this position. What it has first is where it came in. `shown`: the header's that it had before."""
        before = max(self._ends.get(where, position), shown)
        self._ends[where] = max(before, position)
        if position > before + 1:
            return [Wrong(laws.ONE_VALUE, f"{where} goes on at position {position}, and had {before}")]
        return []

    def acknowledged(self, request: Request, position: int) -> list[Wrong]:
        """A client is told so, now: then it is decided, now, on somebody's disk."""
        if position > self.newest or self._at.get(request, position) != position:
            return [
                Wrong(laws.ENTRIES_STAY, f"request {request.hex()[:8]} is acknowledged at position {position}, and is not decided there")
            ]
        return []

    def _misfits(self, where: str, entry: Entry) -> Iterator[Wrong]:
        """The chain: each names the one before it."""
        before, after = self._entries.get(entry.position - 1), self._entries.get(entry.position + 1)
        if before is not None and entry.previous and entry.previous != before.digest:
            yield Wrong(laws.ONE_VALUE, f"{where} has {entry}, which follows {entry.previous.hex()[:8]} and not {before}")
        if after is not None and after.previous and after.previous != entry.digest:
            yield Wrong(laws.ONE_VALUE, f"{where} has {entry}, and {after} follows {after.previous.hex()[:8]}")
