"""The shadows that a space's copies take: made with it, or when it shall have more (specs/16-scene-log.md, Shadows). Pure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import count

from scenefold.base.ids import SpaceId
from scenefold.base.limits import SPACE_NAME_BYTES_MAX
from scenefold.base.location import Location
from scenefold.scene.log.book import SceneLog
from scenefold.scene.log.shadows import free_offsets, sound_shadows
from scenefold.scene.log.space import LoggedSpace
from scenefold.wire import CreateSpace, CurveKind


def with_shadows(created: CreateSpace, log: SceneLog) -> tuple[CreateSpace, ...]:
    """A space that is to be created in this log, and then the shadows for its copies."""
    ids = (number for number in log.free_ids() if number != created.space)
    taken = {created.name, *(space.name for space in log.spaces.values())}
    return created, *shadows_of(created, free_offsets((), created.copies - 1), ids, taken)


def missing_shadows(space: LoggedSpace, copies: int, log: SceneLog) -> list[CreateSpace]:
    """What a space of this log lacks for so many copies; those of its shadows that could count are used again."""
    sound = [shadow.offset for shadow in sound_shadows(log.public_spaces()).get(space.id, ())]
    offsets = free_offsets(sound, max(0, copies - 1 - len(sound)))
    return shadows_of(entry_of(space), offsets, log.free_ids(), {other.name for other in log.spaces.values()})


def free_offset(space: LoggedSpace, log: SceneLog) -> Location:
    """Where one more shadow of a space goes."""
    return free_offsets((shadow.offset for shadow in sound_shadows(log.public_spaces()).get(space.id, ())), 1)[0]


def shadows_of(parent: CreateSpace, offsets: list[Location], ids: Iterator[SpaceId], taken: set[str]) -> list[CreateSpace]:
    """A shadow for each offset, with the next of the ids and a name that is not taken. Names given here are added to those."""
    made = []
    for offset in offsets:
        name = _free_name(parent.name, taken)
        taken.add(name)
        made.append(replace(parent, space=next(ids), parent=parent.space, offset=offset, copies=1, copies_min=1, name=name))
    return made


def _free_name(parent: str, taken: set[str]) -> str:
    """`hall copy 1`, or with the next number that is free; as much of the parent's name as fits."""
    for number in count(1):
        suffix = f" copy {number}"
        kept = parent.encode()[: SPACE_NAME_BYTES_MAX - len(suffix)].decode(errors="ignore")
        if kept + suffix not in taken:
            return kept + suffix
    raise AssertionError("numbers do not end")


def entry_of(space: LoggedSpace) -> CreateSpace:
    """What would create this space, with the copies that it has now."""
    return CreateSpace(
        space=space.id,
        dimensions=space.dimensions,
        curve=CurveKind.Z_ORDER if space.curve == "z-order" else CurveKind.HILBERT,
        node_managed=space.node_managed,
        parent=space.parent,
        offset=space.offset,
        copies=space.copies,
        copies_min=space.copies_min,
        render_output=space.render_output,
        name=space.name,
        low=space.low,
        high=space.high,
    )
