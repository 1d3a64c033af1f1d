"""Records carried on to where their space lies now, and written back so (thesis B.3.3; specs/16-scene-log.md, Transforms).

Who reads a record knows from its header under which log position its coordinates were written, and from the log what happened since.
What is written back expects the very record that was read: of several that do it at once one wins, and nobody's edit is undone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.ids import SpaceId
from scenefold.base.limits import CLIENT_TRIES_MAX
from scenefold.base.location import Location
from scenefold.base.reasons import RejectReason
from scenefold.client.access import SceneAccess
from scenefold.client.editable import editable, fixed_space
from scenefold.client.log_reading import ReadLog
from scenefold.client.progress import ProgressCallback, no_progress
from scenefold.client.sealing import Opened
from scenefold.client.splitting import replace_whole
from scenefold.client.verifying import Key
from scenefold.client.walking import Looked, Walk, Walked
from scenefold.client.wholes import wholes
from scenefold.client.wishes import Wish
from scenefold.scene.log import LoggedSpace
from scenefold.scene.payloads.carrying import Carry
from scenefold.scene.payloads.splits import is_part, is_split
from scenefold.wire import SceneMode

PHASE = "rebase"
_STORED = 0


class Carried(NamedTuple):
    """A payload with coordinates as they are now; None where no record is. `written`: whether it lies there so, by this call."""

    payload: bytes | None
    written: bool = False


@dataclass(slots=True)
class Rebased(Walked):
    """What was written anew with coordinates as they are now. `overtaken`: records that somebody else wrote meanwhile, all the time."""

    phase: str = PHASE
    position: int = 0
    """The log position that coordinates belong to now."""
    behind: int = 0
    """Records from before a step of their space."""
    rebased: int = 0
    unknown: int = 0
    """Payloads that are not of the kind that was said, or would lie too far off; they stay as they are."""
    overtaken: int = 0

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        counts = {name: getattr(self, name) for name in ("position", "behind", "rebased", "unknown", "overtaken")}
        return {**Walked.document(self), **counts}


async def carried(access: SceneAccess, space: SpaceId, locations: Sequence[Location], carry: Carry, *, write_back: bool) -> list[Carried]:
    """See `Space.carried`."""
    log = await access.read_log()
    if write_back:
        fixed_space(access, log, space, "write to")
        access.check_writer()
    # In render mode it is carried on in memory, and no more.
    may_write = write_back and log.header.mode is SceneMode.EDIT
    found = await access.get([(space, location) for location in locations])
    work = _Carrying(access, log, log.state.space(space), carry)
    met = [await work.met(location, one) for location, one in zip(locations, found, strict=True)]
    behind = [one for one in met if one is not None and one.carried is not None]
    written = set[Location]()
    if may_write:
        try:
            written = await work.written(behind)
        except Refused as refusal:
            # The mode was switched in this moment: what was read is right all the same.
            if refusal.reason is not RejectReason.MODE_FORBIDS:
                raise
    return [
        Carried(None) if one is None else Carried(one.whole if one.carried is None else one.carried, one.location in written) for one in met
    ]


async def rebase(
    access: SceneAccess,
    space: SpaceId,
    carry: Carry,
    *,
    dry_run: bool = False,
    progress: ProgressCallback = no_progress,
    bytes_per_s: float | None = None,
) -> Rebased:
    """See `Space.rebase`."""
    if dry_run:
        log = await access.read_log()
        logged = fixed_space(access, log, space, "rebase")
    else:
        log, logged = await editable(access, space, "rebase")
    done = Rebased(is_dry=dry_run, position=log.header.position)
    walk = Walk(access, space, done, progress, bytes_per_s)
    await walk.over_all(_Rebasing(walk, _Carrying(access, log, logged, carry), done).look)
    return done


@dataclass(frozen=True, slots=True)
class _Met:
    """A record, what it holds, and what that is now; `carried` None: nothing happened since, or it cannot be carried on."""

    location: Location
    found: Opened
    whole: bytes
    carried: bytes | None
    is_behind: bool


class _Carrying:
    """What the log says of a space, and what carries on its payloads."""

    def __init__(self, access: SceneAccess, log: ReadLog, space: LoggedSpace, carry: Carry) -> None:
        self._access = access
        self._position = log.header.position
        self._space = space
        self._carry = carry

    async def met(self, location: Location, found: Opened | None) -> _Met | None:
        """None for what is deleted, or not there. A part is given as it is: it is carried on with its record."""
        key: Key = (self._space.id, location)
        for _ in range(CLIENT_TRIES_MAX):
            if found is None or found.deleted:
                return None
            (whole,) = await wholes([found], [key], self._access.get, self._access.in_crypto_lane)
            if whole is not None and whole.version == found.version:
                return await self._met(location, found, whole.payload)
            # It was written while its parts were read.
            (found,) = await self._access.get([key])
        raise Refused(RejectReason.BUSY, "somebody else writes there all the time", where=self._where(location), remedy="try again")

    async def _met(self, location: Location, found: Opened, whole: bytes) -> _Met:
        since = self._space.transform_since(found.content_position)
        if since.is_identity or is_part(found.payload):
            return _Met(location, found, whole, None, is_behind=False)
        return _Met(location, found, whole, await self._access.in_crypto_lane(self._carry, whole, since), is_behind=True)

    async def written(self, behind: Sequence[_Met]) -> set[Location]:
        """Write these back; the places of those that lie there now. Refused if the scene is in render mode by now."""
        plain = [one for one in behind if not is_split(one.found.payload)]
        wishes = [self._wish(one) for one in plain]
        placed = await self._access.put(wishes) if wishes else []
        done = {wish.location for wish, outcome in zip(wishes, placed, strict=True) if outcome.reason == _STORED}
        for one in behind:
            if is_split(one.found.payload) and await self._replaced(one):
                done.add(one.location)
        return done

    async def _replaced(self, one: _Met) -> bool:
        assert one.carried is not None
        return await replace_whole(self._access, self._space, one.location, one.found, one.carried, self._position)

    def _wish(self, one: _Met) -> Wish:
        assert one.carried is not None
        return Wish(self._space.id, one.location, one.carried, one.found.digest, self._position)

    def _where(self, location: Location) -> str:
        return f"scene {self._access.name}, space {self._space.id}, {location.hex()}"


class _Rebasing:
    def __init__(self, walk: Walk, carrying: _Carrying, done: Rebased) -> None:
        self._walk = walk
        self._carrying = carrying
        self._done = done

    async def look(self, _space: SpaceId, places: Sequence[Location], looked: Looked) -> None:
        """Carry on a batch. What somebody else writes meanwhile is looked at again."""
        left = await self._carry_on(places, looked, is_first=True)
        for _ in range(CLIENT_TRIES_MAX - 1):
            if not left:
                return
            left = await self._carry_on(left, await self._walk.looked(left), is_first=False)
        self._done.overtaken += len(left)

    async def _carry_on(self, places: Sequence[Location], looked: Looked, *, is_first: bool) -> list[Location]:
        """Write back those of these records that are behind; which of them somebody else wrote meanwhile."""
        met: list[_Met] = []
        for place, one in zip(places, looked, strict=True):
            try:
                found = await self._carrying.met(place, one) if not isinstance(one, DamagedData) else None
            except DamagedData as damage:
                self._done.unreadable += 1
                self._done.complain(str(damage))
                continue
            if found is not None and found.is_behind:
                met.append(found)
        known = [one for one in met if one.carried is not None]
        if is_first:
            self._done.behind += len(met)
        self._done.unknown += len(met) - len(known)
        if self._done.is_dry:
            return []
        written = await self._carrying.written(known)
        self._done.rebased += len(written)
        return [one.location for one in known if one.location not in written]
