"""Versions that lie in memory to be sent to one holder, and of which records they are: asked for each place of a purge. Pure."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from scenefold.peer.line.unsettled import Name, Pending, name_of


class InHand:
    def __init__(self) -> None:
        self._found: dict[Pending, None] = {}
        self._names: Counter[Name] = Counter()

    def __contains__(self, pending: Pending) -> bool:
        return pending in self._found

    def __iter__(self) -> Iterator[Pending]:
        return iter(self._found)

    def has_of(self, name: Name) -> bool:
        """Whether one of these is a version of this record."""
        return name in self._names

    def add(self, pending: Pending) -> None:
        """What is not here yet."""
        assert pending not in self._found
        self._found[pending] = None
        self._names[name_of(pending.spot)] += 1

    def remove(self, pending: Pending) -> None:
        del self._found[pending]
        name = name_of(pending.spot)
        self._names[name] -= 1
        if not self._names[name]:
            del self._names[name]
