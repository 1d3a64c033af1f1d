"""Records that have rotted, as the store meets them: each counted once, and told of its place once a minute at most.

Whoever asks for such a record, or writes where it lies and is refused, leaves it as it is, and may do so as often as he likes.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Iterable

from scenefold.base.ids import SceneId, SpaceId
from scenefold.crypto import RecordPlace, object_of
from scenefold.store.judging import Put, PutResult
from scenefold.store.layout import SpaceAddress, Spot
from scenefold.world.ports import Clock
from scenefold.world.quiet import QuietLog

MET_MAX = 16_384
"""Rotten records that are remembered, so that none is counted twice. Whatever is met beyond is counted each time, and nobody knows how much it is."""

_Name = tuple[SceneId, SpaceId, bytes]
"""An object is wherever its node put it: its id says which one it is."""


class Noticed:
    """What one store has met since it was opened."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._quiet = QuietLog(logging.getLogger("scenefold.store"), logging.ERROR)
        self._rotten: dict[_Name, Spot] = {}
        """Where each was met."""
        self._given_up: set[_Name] = set()
        self._unremembered = Counter[SpaceAddress]()
        self.has_more = False
        """Whether more were met than could be remembered."""
        self.count = 0
        """Records that reads and writes met, and that had changed on the disk: each once, until it is written anew and rots again."""
        self.hear: Callable[[Spot], None] = _nobody_hears
        """Called whenever a record cannot be read; must return at once."""

    def is_rotten(self, spot: Spot) -> bool:
        """Whether a rotten record was met there, and nothing has been written over it since."""
        return _name(spot) in self._rotten

    def __len__(self) -> int:
        return len(self._rotten)

    def spots(self) -> list[Spot]:
        """Of all that are remembered, in the order in which they were met."""
        return list(self._rotten.values())

    def known(self, spot: Spot) -> Spot:
        """Where what rotted was met first: an object may lie elsewhere by now, and is found all the same."""
        return self._rotten.get(_name(spot), spot)

    def within(self, scene: SceneId, space: SpaceId) -> list[Spot]:
        return [spot for spot in self._rotten.values() if spot.place[:2] == (scene, space)]

    def unremembered(self, scene: SceneId, space: SpaceId) -> int:
        """How often a record of the space whose header has rotted was met and could not be remembered."""
        return self._unremembered[scene, space]

    def give_up(self, spot: Spot) -> None:
        """Nobody has what lay there: all who might have said so."""
        if self.is_rotten(spot):
            self._given_up.add(_name(spot))

    def is_given_up(self, spot: Spot) -> bool:
        return _name(spot) in self._given_up

    def read(self, spot: Spot, problem: str) -> None:
        self._met(spot, "read", problem)
        self.hear(spot)

    def wreck(self, spot: Spot) -> None:
        """Whoever compares has met one whose header has rotted."""
        if self.is_rotten(spot):
            return
        self.read(spot, "its header has changed on the disk")
        if not self.is_rotten(spot):
            self._unremembered[spot.place.scene, spot.place.space] += 1

    def judged(self, put: Put, result: PutResult) -> None:
        """What became of a put: it may have been judged by what is left of the record there, or have taken its place."""
        if not (self._rotten or self._given_up or result.over_wreck or put.is_husk):
            # Nearly always; and each record that is stored comes here.
            return
        header = put.record.header
        spot = Spot(RecordPlace(header.scene, header.space, header.location), object_of(header))
        if result.over_wreck:
            self._met(spot, "write", "a damaged record, whose header has changed on the disk, is in the way of another")
        if result.has_changed:
            self.gone([spot])
            if put.is_husk:
                self.read(spot, "only the header of a record came: its bytes are lost where it lay")

    def gone(self, spots: Iterable[Spot]) -> None:
        """Nothing rotten lies there any more."""
        for name in map(_name, spots):
            self._rotten.pop(name, None)
            self._given_up.discard(name)

    def _met(self, spot: Spot, kind: str, text: str) -> None:
        (scene, space, _), _ = spot
        name = _name(spot)
        if name not in self._rotten:
            self.count += 1
            if len(self._rotten) < MET_MAX:
                self._rotten[name] = spot
            else:
                self.has_more = True
        what = f"object {spot.object.hex()}" if spot.object else spot.place.location.hex()
        self._quiet.say(self._clock.now(), f"scene {scene:08x}, space {space}, {what}", kind, text)


def _name(spot: Spot) -> _Name:
    (scene, space, location), object_id = spot
    return scene, space, object_id or location


def _nobody_hears(_spot: Spot) -> None:
    """It is met again."""
