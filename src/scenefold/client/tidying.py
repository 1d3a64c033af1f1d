"""What ended splittings and merges have left, found and removed (specs/18-data.md, Splitting and merging).

A walk looks at every part that lies in a space, and at its entry point. Nothing is remembered: what is done is gone, so a walk may end at
any moment, and another one finds the rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from scenefold.base.errors import DamagedData
from scenefold.base.ids import SpaceId
from scenefold.base.location import Location
from scenefold.client.access import SceneAccess
from scenefold.client.editable import editable, fixed_space
from scenefold.client.leftovers import Standing, part_in, remove, remove_leftovers, standing_of
from scenefold.client.progress import ProgressCallback, no_progress
from scenefold.client.sealing import Opened
from scenefold.client.walking import Looked, Walk, Walked
from scenefold.client.wishes import Wish

PHASE = "tidy"
_STORED = 0


@dataclass(slots=True)
class Tidied(Walked):
    """What a walk found of parts, and how many it removed. `orphaned`: parts whose record is not there at all."""

    phase: str = PHASE
    in_use: int = 0
    pending: int = 0
    """Of splittings that were begun, and are not ended."""
    left_over: int = 0
    orphaned: int = 0
    unclear: int = 0
    removed: int = 0

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        parts = {name: getattr(self, name) for name in ("in_use", "pending", "left_over", "orphaned", "unclear", "removed")}
        # By name: a dataclass with slots is another class than the one that `super()` speaks of.
        return {**Walked.document(self), **parts}


async def tidy(
    access: SceneAccess,
    space: SpaceId,
    *,
    orphans: bool = False,
    dry_run: bool = False,
    progress: ProgressCallback = no_progress,
    bytes_per_s: float | None = None,
) -> Tidied:
    """See `Space.tidy`."""
    if dry_run:
        fixed_space(access, await access.read_log(), space, "tidy")
    else:
        await editable(access, space, "tidy")
    found = Tidied(is_dry=dry_run)
    walk = Walk(access, space, found, progress, bytes_per_s)
    await walk.over_all(_Tidying(access, walk, found, orphans=orphans).look)
    return found


class _Tidying:
    def __init__(self, access: SceneAccess, walk: Walk, found: Tidied, *, orphans: bool) -> None:
        self._access = access
        self._walk = walk
        self._found = found
        self._orphans = orphans

    async def look(self, space: SpaceId, places: Sequence[Location], looked: Looked) -> None:
        """Judge the parts of a batch, and remove those that nobody needs."""
        found = self._found
        parts = {
            place: (one, part) for place, one in zip(places, looked, strict=True) if isinstance(one, Opened) and (part := part_in(one))
        }
        at = list({part.entry for _, part in parts.values()})
        entries = dict(zip(at, await self._walk.looked(at), strict=True))
        kinds: dict[Standing, dict[Location, Opened]] = {kind: {} for kind in Standing}
        pending_at: set[Location] = set()
        for place, (one, part) in parts.items():
            kind = standing_of(part, place, one.payload, entries[part.entry], self._access.identity.genesis)
            kinds[kind][place] = one
            if kind is Standing.PENDING:
                pending_at.add(part.entry)
            elif kind is Standing.UNCLEAR:
                found.complain(f"{self._walk.where(place)}: the record that this is a part of cannot be read")
        found.in_use += len(kinds[Standing.IN_USE])
        found.pending += len(kinds[Standing.PENDING])
        found.left_over += len(kinds[Standing.LEFT_OVER])
        found.orphaned += len(kinds[Standing.ORPHANED])
        found.unclear += len(kinds[Standing.UNCLEAR])
        if found.is_dry:
            return
        fenced = await self._fence(space, {place: entries[place] for place in pending_at})
        given_up = {place: one for place, one in kinds[Standing.PENDING].items() if parts[place][1].entry in fenced}
        # Somebody wrote there in between, perhaps the look at another batch: they may be left over by now.
        found.removed += await remove_leftovers(self._access, space, [place for place in kinds[Standing.PENDING] if place not in given_up])
        orphans = kinds[Standing.ORPHANED] if self._orphans else {}
        found.removed += await remove(self._access, space, {**kinds[Standing.LEFT_OVER], **given_up, **orphans})

    async def _fence(self, space: SpaceId, entries: dict[Location, Opened | DamagedData | None]) -> set[Location]:
        """Put these records anew as they are, so that nobody who has read them before splits them any more; which are new now."""
        there = {place: one for place, one in entries.items() if isinstance(one, Opened)}
        wishes = [Wish(space, place, one.payload, one.digest, one.content_position) for place, one in there.items()]
        placed = await self._access.put(wishes) if wishes else []
        return {wish.location for wish, outcome in zip(wishes, placed, strict=True) if outcome.reason == _STORED}
