"""A space turns when other shadows of it count than before: its layout becomes one that nobody ever had (specs/23-turns.md). Pure.

Whoever holds copies by a layout says of all its spaces what is there. So a layout that a space comes to have must be new, and one that
it had must be known as such. Both follow from the header: a layout is offsets of a space's shadows, shifted by a number that names scene,
space and the position of the turn.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from scenefold.base.ids import SPACE_ID_MAX, SceneId, SpaceId
from scenefold.base.location import FIRST, LINE_LENGTH, Location

_SCENES = 1 << 32
_OF_ONE_POSITION = _SCENES * (SPACE_ID_MAX + 1)
"""Shifts of two positions are that far apart at least."""


def shift_of(scene: SceneId, space: SpaceId, position: int) -> int:
    """What is added to the offsets of a space's shadows since it turned there; 0 if it never did."""
    return position * _OF_ONE_POSITION + scene * (SPACE_ID_MAX + 1) + space if position else 0


def shifted(offsets: Iterable[Location], shift: int) -> tuple[Location, ...]:
    """The layout of these offsets. Nobody's copies belong where the records are."""
    found = (Location.from_number((offset.number + shift) % LINE_LENGTH) for offset in offsets)
    return tuple(offset for offset in found if offset != FIRST)


@dataclass(frozen=True, slots=True)
class Turn:
    """The last one of a space. `offsets`: of all shadows that it has, those that do not count now among them."""

    scene: SceneId
    space: SpaceId
    position: int
    offsets: frozenset[int]

    def may_have_had(self, layout: Sequence[Location]) -> bool:
        """Whether this may have been the space's layout before it turned."""
        return bool(layout) and any(self._is_of(layout, shift) for shift in self._shifts(layout[0].number))

    def _shifts(self, first: int) -> Iterator[int]:
        """By which shifts of before a shadow would come there."""
        for offset in self.offsets:
            shift = (first - offset) % LINE_LENGTH
            position = shift // _OF_ONE_POSITION
            if position < self.position and shift == shift_of(self.scene, self.space, position):
                yield shift

    def _is_of(self, layout: Sequence[Location], shift: int) -> bool:
        return all((offset.number - shift) % LINE_LENGTH in self.offsets for offset in layout)
