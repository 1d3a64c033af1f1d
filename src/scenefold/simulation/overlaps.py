"""Faults of one kind on one target may overlap: the worst of those under way is in force, until the last of them ends. Pure."""

from __future__ import annotations

from collections.abc import Hashable
from typing import Generic, TypeVar

from scenefold.simulation.faults import Fault

T = TypeVar("T", bound=Hashable)


class Overlaps(Generic[T]):
    """What is under way, by target."""

    def __init__(self) -> None:
        self._under_way: dict[T, list[Fault]] = {}

    def begin(self, target: T, fault: Fault) -> bool:
        """Whether it is the first there."""
        under_way = self._under_way.setdefault(target, [])
        under_way.append(fault)
        return len(under_way) == 1

    def end(self, target: T, fault: Fault) -> bool:
        """Whether it was the last there."""
        self._under_way[target].remove(fault)
        return not self._under_way[target]

    def worst(self, target: T) -> float | None:
        """The amount that is farthest from nothing; None if nothing is under way."""
        return max((fault.amount for fault in self._under_way.get(target, ())), key=abs, default=None)
