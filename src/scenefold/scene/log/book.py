"""`SceneLog`: the state that a scene's records add up to (consensus.md §3; thesis B.3.1; specs/16-scene-log.md, Folding).

A pure fold: `log.extended(records)` gives the next state, or Refused (ILL_FORMED) for a record that does not fit, and leaves
the old one as it was. So a reader folds all of them. A proposer applies its record before it sends it, and `apply` is stricter: what
only early programs put into logs nobody adds to one.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import chain
from types import MappingProxyType
from typing import TypeVar

from scenefold.base.errors import LocalFault, Refused
from scenefold.base.ids import SPACE_ID_MAX, NodeId, SpaceId
from scenefold.base.limits import LOG_REQUESTS_KEPT, SPACES_PER_SCENE_MAX
from scenefold.base.reasons import RejectReason
from scenefold.scene.log.affine import Affine
from scenefold.scene.log.frozen import check_mode, frozen
from scenefold.scene.log.grants import Grants
from scenefold.scene.log.resolution import lost_by
from scenefold.scene.log.roster import Roster
from scenefold.scene.log.shadows import check_added
from scenefold.scene.log.space import LoggedSpace, Step
from scenefold.scene.log.turning import may_turn, turned
from scenefold.wire import (
    NO_RECORD,
    AddObserver,
    AddParticipant,
    Batch,
    BeginPurge,
    CreateSpace,
    CurveKind,
    EndScene,
    Grant,
    KeyEpoch,
    LogEntry,
    LogRecord,
    RemoveObserver,
    RemoveParticipant,
    RenderSettings,
    Revoke,
    ScaleSpace,
    SceneMode,
    SetCopies,
    SetMode,
    SpaceEntry,
    TranslateSpace,
)

Key = TypeVar("Key")
Value = TypeVar("Value")


@dataclass(frozen=True, slots=True)
class SceneLog:
    """A log up to `position`; 0 is the empty one. `head`: the hash of its last record."""

    position: int = 0
    head: bytes = NO_RECORD
    mode: SceneMode = SceneMode.EDIT
    write_floor: int = 0
    """Position of the newest change of mode, revocation, key epoch, purge, or of the end: records of an earlier epoch are refused from then on."""
    purged: int = 0
    """Position at which the newest purge of deletions began; 0: none did."""
    spaces: Mapping[SpaceId, LoggedSpace] = field(default_factory=lambda: MappingProxyType({}))
    """In the order of their creation."""
    roster: Roster = field(default_factory=Roster)
    grants: Grants = field(default_factory=Grants)
    render: RenderSettings = field(default_factory=RenderSettings)
    """What an image is by default."""
    requests: Mapping[bytes, int] = field(default_factory=lambda: MappingProxyType({}), repr=False)
    """The positions of the request ids that are in the log, of the newest LOG_REQUESTS_KEPT positions: all, of most logs."""

    @classmethod
    def of(cls, records: Iterable[LogRecord]) -> SceneLog:
        """The fold of all records from the first on."""
        return cls().extended(records)

    def apply(self, record: LogRecord) -> SceneLog:
        """The log with one more record, as its author adds it; Refused if it does not follow, does not fit, or makes shadows that would not count,
        (9) if the scene's mode forbids it."""
        after = self.extended((record,))
        check_mode(self.mode, self.spaces, record.entry)
        check_added(self.public_spaces(), after.public_spaces())
        return after

    def extended(self, records: Iterable[LogRecord]) -> SceneLog:
        """The log with more records, as a reader takes them; Refused if one does not follow, or does not fit."""
        # One dict for all of them: a log may have tens of thousands of records.
        log, requests = self, dict(self.requests)
        for record in records:
            log = log._followed(record, requests)
            requests[record.request_id] = record.position
        if len(requests) > LOG_REQUESTS_KEPT:
            requests = {request: position for request, position in requests.items() if position > log.position - LOG_REQUESTS_KEPT}
        return replace(log, requests=MappingProxyType(requests))

    def _followed(self, record: LogRecord, requests: Mapping[bytes, int]) -> SceneLog:
        if record.position != self.position + 1 or record.prev_hash != self.head:
            raise _ill_formed(f"a record for position {record.position} does not follow position {self.position}")
        if requests.get(record.request_id, 0) > max(0, self.position - LOG_REQUESTS_KEPT):
            raise _ill_formed(f"this request is in the log already, at position {requests[record.request_id]}")
        log = self._entered(record.entry, record.position)
        log.grants.check_whole(record.position)
        log.roster.check_follows(self.roster)
        spaces = turned(self.spaces, log.spaces, record.position) if may_turn(record.entry) else log.spaces
        return replace(log, position=record.position, head=record.hash(), spaces=spaces)

    def next_record(self, entry: LogEntry, request_id: bytes, origin: NodeId) -> LogRecord:
        """The record that would bring `entry` into this log."""
        return LogRecord(self.position + 1, self.head, request_id, origin, entry)

    def tells_of(self, position: int) -> bool:
        """Whether a request that was never offered before this position, and is not among `requests`, is not in the log."""
        return position > self.position - LOG_REQUESTS_KEPT

    def space(self, space: SpaceId) -> LoggedSpace:
        """The space of this id; LocalFault if there is none."""
        found = self.spaces.get(space)
        if found is None:
            raise LocalFault("the scene has no such space", where=f"space {space}", remedy=f"it has {self._names()}")
        return found

    def named(self, name: str) -> LoggedSpace:
        """The space of this name; LocalFault if there is none."""
        for space in self.spaces.values():
            if space.name == name:
                return space
        raise LocalFault(f"the scene has no space {name[:64]!r}", where="space name", remedy=f"it has {self._names()}")

    def free_ids(self) -> Iterator[SpaceId]:
        """Ids that were never given: those above all that were, then the others, each lowest first."""
        above = max(self.spaces, default=0) + 1
        return (SpaceId(number) for number in chain(range(above, SPACE_ID_MAX + 1), range(1, above)) if number not in self.spaces)

    def public_spaces(self) -> tuple[SpaceEntry, ...]:
        """What the public header says of the spaces, in the order of their creation."""
        return tuple(space.public() for space in self.spaces.values())

    def _names(self) -> str:
        return ", ".join(space.name or str(space.id) for space in self.spaces.values() if not space.parent) or "none"

    # -------------------------------------------------------------------------------------------------- entries

    def _entered(self, entry: LogEntry, position: int) -> SceneLog:
        if self.mode is SceneMode.ENDED:
            raise _ill_formed(f"the scene was ended at position {self.write_floor}: nothing follows", "make another scene")
        match entry:
            case Batch():
                log = self
                for part in entry.entries:
                    log = log._entered(part, position)
                return log
            case CreateSpace():
                return self.with_space(entry, position)
            case TranslateSpace():
                space = self._moved(entry.space)
                if len(entry.offset) != space.dimensions:
                    raise _ill_formed(f"an offset of {len(entry.offset)} coordinates in a space of {space.dimensions} dimensions")
                return self._stepped(space, Step(position, 1.0, entry.offset))
            case ScaleSpace():
                space = self._moved(entry.space)
                return self._stepped(space, Step(position, entry.factor, (0.0,) * space.dimensions))
            case SetCopies():
                space = self._copied(entry.space)
                return replace(self, spaces=_with(self.spaces, space.id, replace(space, copies=entry.copies, copies_min=entry.copies_min)))
            case SetMode() | BeginPurge() | EndScene() | RenderSettings():
                return self._by_mode(entry, position)
            case Grant() | Revoke() | KeyEpoch():
                return self._regranted(entry, position)
            case AddParticipant() | RemoveParticipant() | AddObserver() | RemoveObserver():
                return replace(self, roster=self.roster.entered(entry))
            case _:
                raise _ill_formed(f"{type(entry).__name__} has no place in a scene's log")

    def _by_mode(self, entry: SetMode | BeginPurge | EndScene | RenderSettings, position: int) -> SceneLog:
        if isinstance(entry, SetMode):
            if entry.mode is SceneMode.ENDED:
                raise _ill_formed("a scene is ended by its last entry, and by no change of its mode")
            return replace(self, mode=entry.mode, write_floor=position)
        if isinstance(entry, RenderSettings):
            if self.mode is not SceneMode.EDIT:
                raise frozen("what an image is by default changes in edit mode alone")
            return replace(self, render=entry)
        if isinstance(entry, BeginPurge):
            if self.mode is not SceneMode.EDIT:
                raise frozen("nothing is purged while the scene is rendered")
            return replace(self, purged=position, write_floor=position)
        if position == 1:
            raise _ill_formed("a scene begins before it ends")
        if self.mode is not SceneMode.EDIT:
            raise frozen("the scene is in render mode, and is ended in edit mode alone")
        return replace(self, mode=SceneMode.ENDED, write_floor=position)

    def _regranted(self, entry: Grant | Revoke | KeyEpoch, position: int) -> SceneLog:
        match entry:
            case Grant():
                return replace(self, grants=self.grants.granted(entry, position))
            case Revoke():
                return replace(self, grants=self.grants.revoked(entry, position), write_floor=position)
            case KeyEpoch():
                return replace(self, grants=self.grants.rekeyed(entry, position), write_floor=position)

    def with_space(self, entry: CreateSpace, position: int) -> SceneLog:
        """The log with one more space, created at this position; Refused if it does not fit."""
        if entry.space in self.spaces:
            raise _ill_formed(f"there is a space {entry.space} already")
        if not entry.name or any(space.name == entry.name for space in self.spaces.values()):
            raise _ill_formed(f"a space needs a name of its own, not {entry.name!r}")
        if len(self.spaces) >= SPACES_PER_SCENE_MAX:
            raise _ill_formed(f"a scene has at most {SPACES_PER_SCENE_MAX} spaces, shadows included")
        if not 1 <= entry.copies_min <= entry.copies:
            raise _ill_formed(f"{entry.copies} copies, of which {entry.copies_min} must be there")
        if not all(map(math.isfinite, (*entry.low, *entry.high))):
            raise _ill_formed("the box of a space is finite")
        created = LoggedSpace(
            id=entry.space,
            name=entry.name,
            dimensions=entry.dimensions,
            curve="z-order" if entry.curve is CurveKind.Z_ORDER else "hilbert",
            low=entry.low,
            high=entry.high,
            transform=Affine.identity(entry.dimensions),
            node_managed=entry.node_managed,
            parent=entry.parent,
            offset=entry.offset,
            copies=entry.copies,
            copies_min=entry.copies_min,
            render_output=entry.render_output,
            created=position,
        )
        if entry.parent:
            created = self._shadow(created)
        return replace(self, spaces=_with(self.spaces, entry.space, _resolved(created)))

    def _shadow(self, shadow: LoggedSpace) -> LoggedSpace:
        parent = self._there(shadow.parent)
        if parent.parent:
            what = f"space {parent.id} is a shadow itself, and has none of its own"
            raise _ill_formed(what, f"name space {parent.parent}, whose copies it holds")
        if _shape(parent) != _shape(shadow):
            raise _ill_formed(f"a shadow has the dimensions, curve, management and box of its parent, space {parent.id}")
        # It holds what its parent holds, so it lies where that lies.
        return replace(shadow, transform=parent.transform, steps=parent.steps)

    def _there(self, space: SpaceId) -> LoggedSpace:
        found = self.spaces.get(space)
        if found is None:
            raise _ill_formed(f"there is no space {space}")
        return found

    def _copied(self, space: SpaceId) -> LoggedSpace:
        found = self._there(space)
        if found.parent:
            raise _ill_formed(f"space {space} holds the copies of space {found.parent}, and has none of its own")
        return found

    def _moved(self, space: SpaceId) -> LoggedSpace:
        found = self._there(space)
        if found.parent:
            raise _ill_formed(f"space {space} is a shadow: its addresses mean what they mean in space {found.parent}")
        if found.node_managed:
            raise _ill_formed(f"the nodes choose the places in space {space}: they have no positions")
        return found

    def _stepped(self, space: LoggedSpace, step: Step) -> SceneLog:
        moved = _resolved(space.stepped(step))
        spaces = {**self.spaces, space.id: moved}
        for shadow in [other for other in spaces.values() if other.parent == space.id]:
            spaces[shadow.id] = replace(shadow, transform=moved.transform, steps=moved.steps)
        return replace(self, spaces=MappingProxyType(spaces))


def _with(mapping: Mapping[Key, Value], key: Key, value: Value) -> Mapping[Key, Value]:
    return MappingProxyType({**mapping, key: value})


def _shape(space: LoggedSpace) -> tuple[object, ...]:
    return space.dimensions, space.curve, space.node_managed, space.low, space.high


def _resolved(space: LoggedSpace) -> LoggedSpace:
    """The space; Refused if its places cannot be told apart where it lies. Where nodes choose, there are none."""
    lost = None if space.node_managed else lost_by(space)
    if lost is not None:
        raise _ill_formed(lost.what, lost.remedy)
    return space


def _ill_formed(what: str, remedy: str = "") -> Refused:
    return Refused(RejectReason.ILL_FORMED, what, where="scene log", remedy=remedy)
