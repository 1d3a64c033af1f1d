"""Runs of occupied locations (specs/16-scene-log.md, Boxes).

Who finds a place taken goes on along the line to the next free one, from the line's end on at its beginning. So between the
place that a record wanted and the one where it lies there is no gap, and whoever looks for it follows the run.
"""

from __future__ import annotations

from collections.abc import AsyncGenerator

from scenefold.base.ids import SpaceId
from scenefold.base.location import LAST, LINE_LENGTH, Location
from scenefold.client.access import SceneAccess

STEPS_MAX = 65_536
"""Places tried for one wanted location: a record lies within so many of it."""
_PAGE_MIN, _PAGE_MAX = 64, 4_096


def stepped(location: Location, steps: int) -> Location:
    """So many places on; from the end of the line it goes on at its beginning."""
    return Location.from_number((location.number + steps) % LINE_LENGTH)


async def run_behind(access: SceneAccess, space: SpaceId, location: Location, steps: int = STEPS_MAX) -> AsyncGenerator[Location, None]:
    """The occupied locations behind this one, up to the first gap, or so many."""
    at, page, left = stepped(location, 1), _PAGE_MIN, steps
    while left > 0:
        last = Location.from_number(min(at.number + min(page, left) - 1, LAST.number))
        # All of the page is read before anything is given, so that who has enough leaves no question open.
        found = [location async for location in access.locations(space, at, last)]
        for number, location in enumerate(found, at.number):
            if location.number != number:
                return
            yield location
        if len(found) <= last.number - at.number:
            return
        left -= len(found)
        at, page = stepped(last, 1), min(4 * page, _PAGE_MAX)


class Run:
    """Which occupied locations, shown in the order of the line, may hold a record that wanted a place in a box. Pure.

    Those in its cells, and those of a run that begins there: what they wanted nobody can tell from where they lie.
    """

    def __init__(self) -> None:
        self._last: Location | None = None
        self._steps = 0

    @property
    def last(self) -> Location | None:
        """Where the run has come to; None outside of one."""
        return self._last

    def keeps(self, location: Location, inside: bool) -> bool:
        """Whether this location, the next occupied one, belongs to the box. `inside`: it lies in one of its cells."""
        if inside:
            self._last, self._steps = location, 0
        elif self._last is not None and location == stepped(self._last, 1) and self._steps + 1 < STEPS_MAX:
            self._last, self._steps = location, self._steps + 1
        else:
            self._last = None
        return self._last is not None
