"""Which location a new record asks for, so that equal centres never overwrite each other (storage.md, *The line*).

An importer's records want the curve index of their centre, and several may want the same. Within one import
this class knows which places it has given out and steps over them without asking; what lies there from
elsewhere the owner of the place says (STALE_VERSION), and the record steps on by one.
"""

from __future__ import annotations

from scenefold.base.errors import LocalFault
from scenefold.base.ids import SpaceId
from scenefold.base.location import Location
from scenefold.client.runs import STEPS_MAX, stepped


class FreePlaces:
    """The places that one import has asked for. Memory: some 150 bytes a record."""

    def __init__(self) -> None:
        self._next: dict[tuple[SpaceId, Location], int] = {}
        self._given: set[tuple[SpaceId, Location]] = set()

    def take(self, space: SpaceId, wanted: Location) -> Location:
        """The next place along the line from `wanted` that was not given out before."""
        step = self._next.get((space, wanted), 0)
        while step < STEPS_MAX:
            place = stepped(wanted, step)
            step += 1
            if (space, place) not in self._given:
                self._next[space, wanted] = step
                self._given.add((space, place))
                return place
        raise LocalFault(
            f"more than {STEPS_MAX} records want the same place",
            where=f"space {space}, {wanted.hex()}",
            remedy="the scene is smaller than its lattice can tell apart; scale it up",
        )

    def claim(self, space: SpaceId, place: Location) -> bool:
        """Keep a place that was not given out for whoever found it; False if it was."""
        if (space, place) in self._given:
            return False
        self._given.add((space, place))
        return True
