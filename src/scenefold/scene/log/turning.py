"""Which spaces a record of the log turns: those that were there, and of which other shadows count now (specs/23-turns.md). Pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

from scenefold.base.ids import SpaceId
from scenefold.scene.log.shadows import Layouts
from scenefold.scene.log.space import LoggedSpace
from scenefold.wire import Batch, CreateSpace, LogEntry, SetCopies

_Spaces = Mapping[SpaceId, LoggedSpace]


def may_turn(entry: LogEntry) -> bool:
    """Whether other shadows may count after this entry."""
    if isinstance(entry, Batch):
        return any(map(may_turn, entry.entries))
    return isinstance(entry, SetCopies) or (isinstance(entry, CreateSpace) and entry.parent != 0)


def turned(before: _Spaces, after: _Spaces, position: int) -> _Spaces:
    """The spaces after a record of this position. `before` and `after` it, but for that."""
    counted, counting = _counting(before), _counting(after)
    turning = {number for number, shadows in counted.items() if counting[number] != shadows}
    return MappingProxyType({number: replace(space, turned=position) if number in turning else space for number, space in after.items()})


def _counting(spaces: _Spaces) -> Mapping[SpaceId, tuple[SpaceId, ...]]:
    """Of each space that is no shadow, those that count."""
    return Layouts.of(space.public() for space in spaces.values()).shadows
