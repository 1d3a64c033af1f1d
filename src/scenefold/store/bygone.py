"""What can only come too late: versions older than one that is about to be dropped (specs/22-purge.md, Marks). In memory.

As long as a deleted record lies somewhere, an older version that arrives there loses. Once it is dropped, a message that was on
its way all the time would bring the older one back. Such a message ends with the process that it was sent to; so does what is
remembered here, and until then it is refused as it would have been before.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from scenefold.base.ids import SceneId
from scenefold.crypto import object_of, version_key
from scenefold.store.judging import Put
from scenefold.store.layout import Spot

BYGONE_MAX = 131_072
"""Records of which this is remembered: some 40 MB. Beyond it the oldest go, if they are old enough."""
BYGONE_S = 600.0
"""Longer than any message is on its way: connections end that do not move for half a minute, and handlers give up before that."""

Version = tuple[int, int, int, int, bytes]
"""What versions of a record are ordered by."""
_Name = tuple[int, int, bytes]


class _Mark(NamedTuple):
    version: Version
    at: float


class Bygone:
    """Of one open store. Used from the Trio thread only."""

    def __init__(self, now: Callable[[], float]) -> None:
        """`now`: seconds of the clock by which connections end. Like these it may stand still while a machine sleeps."""
        self._now = now
        self._marks: dict[_Name, _Mark] = {}
        """The one that was marked last stands last."""
        self.ended: set[SceneId] = set()
        """Scenes of which nothing is taken any more (specs/16-scene-log.md, The end)."""

    def mark(self, versions: Sequence[tuple[Spot, Version]]) -> bool:
        """From now on nothing older than these is taken. False if there is no room for that, and nothing is marked."""
        now = self._now()
        names = [_name(spot) for spot, _ in versions]
        if not self._make_room(sum(name not in self._marks for name in names), now):
            return False
        for name, (_, version) in zip(names, versions, strict=True):
            known = self._marks.pop(name, None)
            self._marks[name] = _Mark(version if known is None else max(version, known.version), now)
        return True

    def is_marked(self, spot: Spot, version: Version) -> bool:
        """Whether this very version is the one that was marked last."""
        known = self._marks.get(_name(spot))
        return known is not None and known.version == version

    def late(self, puts: Sequence[Put]) -> dict[int, bytes]:
        """Which of these come too late, each with the digest of the version that it is older than."""
        if not self._marks and not self.ended:
            return {}
        late: dict[int, bytes] = {}
        for index, put in enumerate(puts):
            header = put.record.header
            if header.scene in self.ended:
                late[index] = header.digest
                continue
            known = self._marks.get((header.scene, header.space, object_of(header) or header.location))
            if known is not None and version_key(header) < known.version:
                late[index] = known.version[-1]
        return late

    def _make_room(self, count: int, now: float) -> bool:
        while len(self._marks) + count > BYGONE_MAX:
            oldest = next(iter(self._marks), None)
            if oldest is None or now - self._marks[oldest].at < BYGONE_S:
                return False
            del self._marks[oldest]
        return True


def _name(spot: Spot) -> _Name:
    """Which record it is, wherever an object lies."""
    return spot.place.scene, spot.place.space, spot.object or spot.place.location
