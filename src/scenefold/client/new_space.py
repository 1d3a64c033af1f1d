"""What a new space shall be: arguments checked into the entry that creates it (specs/16-scene-log.md, CreateSpace)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from types import NoneType
from typing import NamedTuple, Self, TypeAlias, TypedDict

from scenefold.base.arguments import as_floats
from scenefold.base.errors import LocalFault, UsageFault
from scenefold.base.ids import SpaceId
from scenefold.base.limits import SPACE_DIMENSIONS_MAX, SPACE_NAME_BYTES_MAX
from scenefold.base.location import FIRST, LOCATION_BYTES, Location
from scenefold.base.names import SPACE_NAME_RULE, is_space_name
from scenefold.client.copies import BY_DEFAULT, Copies, whole_option
from scenefold.curve import CurveKind
from scenefold.scene.log import LoggedSpace, SceneLog, free_offset, with_shadows
from scenefold.scene.log.space import NO_SPACE
from scenefold.wire import Batch, CreateSpace
from scenefold.wire import CurveKind as CurveNumber

Box: TypeAlias = tuple[Sequence[float], Sequence[float]]
_NUMBERS = {"hilbert": CurveNumber.HILBERT, "z-order": CurveNumber.Z_ORDER}


class SpaceOptions(TypedDict, total=False):
    """All that a space may be told beside its name and box."""

    dimensions: int
    """1 to 8; by default 3, or as many as the box has."""
    curve: CurveKind
    """hilbert (by default), or z-order."""
    node_managed: bool
    """The nodes choose where records lie, and take them along when bounds move. There is no box then."""
    render_output: bool
    """May be written while the scene is being rendered."""
    space_id: int
    """By default the next one that was never used."""
    parent: str | int
    """Makes a shadow of the space of this name or number, with its dimensions, curve, management and box: those are not given then."""
    offset: Location
    """Of a shadow: how far from a record its copy belongs, round the end of the line; by default where there is most room."""
    copies: int
    """How many nodes shall hold each record, the owner among them: 1 to 8, by default 3. The shadows that this takes are made with the space."""
    copies_min: int
    """How many must hold it before a write counts as done; by default 2, or `copies` if that is less."""


def new_space(
    name: str,
    box: Box | None = None,
    *,
    dimensions: int | None = None,
    curve: CurveKind | None = None,
    node_managed: bool | None = None,
    render_output: bool = False,
    space_id: int | None = None,
    parent: str | int | None = None,
    offset: Location | None = None,
    copies: int | None = None,
    copies_min: int | None = None,
) -> Callable[[SceneLog], CreateSpace | Batch]:
    """The entry that creates the space and its shadows, once it is known what the log says. UsageFault for what cannot be."""
    if not isinstance(name, str):
        raise UsageFault(f"a {type(name).__name__} cannot be the name of a space", where="space name", remedy="give a text")
    where = f"space {name[:SPACE_NAME_BYTES_MAX]}"
    if not is_space_name(name):
        what = f"{name[:SPACE_NAME_BYTES_MAX]!r} cannot be the name of a space"
        raise UsageFault(what, where="space name", remedy=f"use {SPACE_NAME_RULE}")
    if parent is not None and any(given is not None for given in (box, dimensions, curve, node_managed)):
        what = "a shadow has the box, dimensions, curve and management of its parent"
        raise UsageFault(what, where=where, remedy="leave them out")
    if parent is None and offset is not None:
        raise UsageFault("only a shadow has an offset", where=where, remedy="name its parent, or leave the offset out")
    for option, flag in (("node_managed", node_managed), ("render_output", render_output)):
        if not isinstance(flag, (bool, NoneType)):
            raise UsageFault(f"{option} is true or false, not a {type(flag).__name__}", where=where)
    if parent is not None and not isinstance(parent, str):
        parent = whole_option(where, "parent", parent)
    if space_id is not None:
        space_id = whole_option(where, "space_id", space_id)
    if parent is not None and (copies, copies_min) != (None, None):
        what = "a shadow is one copy itself, and has none"
        raise UsageFault(what, where=where, remedy="`scenectl space copies` says how many its parent shall have")
    at = None if offset is None else _location(where, offset)
    wanted = Copies.checked(where, (BY_DEFAULT.copies if parent is None else 1) if copies is None else copies, copies_min)
    shape = _Shape.of(where, box, dimensions, curve, node_managed=bool(node_managed))

    def entry(log: SceneLog) -> CreateSpace | Batch:
        _check_free(where, name, space_id, log)
        of = None if parent is None else log.space(SpaceId(parent)) if isinstance(parent, int) else log.named(parent)
        like = shape if of is None else _Shape.like(of)
        created = CreateSpace(
            space=next(log.free_ids()) if space_id is None else SpaceId(space_id),
            dimensions=like.dimensions,
            curve=_NUMBERS[like.curve],
            node_managed=like.node_managed,
            parent=NO_SPACE if of is None else of.id,
            offset=FIRST if of is None else free_offset(of, log) if at is None else at,
            copies=wanted.copies,
            copies_min=wanted.least,
            render_output=render_output,
            name=name,
            low=like.low,
            high=like.high,
        )
        return created if created.copies == 1 else Batch(with_shadows(created, log))

    return entry


def _check_free(where: str, name: str, space_id: int | None, log: SceneLog) -> None:
    remedy = "choose another one; `scenectl space list` shows those that there are"
    for space in log.spaces.values():
        if space.name == name:
            raise LocalFault(f"the scene has a space {name!r} already, its number is {space.id}", where=where, remedy=remedy)
        if space.id == space_id:
            raise LocalFault(f"the number {space.id} is that of the space {space.name!r}", where=where, remedy=remedy)


class _Shape(NamedTuple):
    """What a space and its shadows have in common."""

    dimensions: int
    curve: CurveKind
    node_managed: bool
    low: tuple[float, ...]
    high: tuple[float, ...]

    @classmethod
    def like(cls, space: LoggedSpace) -> Self:
        return cls(space.dimensions, space.curve, space.node_managed, space.low, space.high)

    @classmethod
    def of(cls, where: str, box: Box | None, dimensions: int | None, curve: CurveKind | None, *, node_managed: bool) -> Self:
        curve = "hilbert" if curve is None else curve
        if not isinstance(curve, str) or curve not in _NUMBERS:
            raise UsageFault(f"there is no curve {curve!r:.40}", where=where, remedy="use hilbert or z-order")
        if box is not None and node_managed:
            what = "where the nodes choose the places there are no positions, and no box"
            raise UsageFault(what, where=where, remedy="leave the box out, or let the space be managed by its users")
        corners = None if box is None else _corners(where, box)
        count = 3 if corners is None else len(corners[0])
        if dimensions is not None:
            count = whole_option(where, "dimensions", dimensions)
        if not 1 <= count <= SPACE_DIMENSIONS_MAX:
            what = f"a space has 1 to {SPACE_DIMENSIONS_MAX} dimensions, not {count}"
            raise UsageFault(what, where=where, remedy="choose as many as positions have coordinates")
        low, high = corners or ((0.0,) * count, (1.0,) * count)
        if not len(low) == len(high) == count:
            what = f"a corner of the box has {count} coordinates, not {len(low)} and {len(high)}"
            raise UsageFault(what, where=where, remedy="give one for each dimension")
        if not all(map(math.isfinite, (*low, *high))):
            raise UsageFault("the box of a space is finite", where=where, remedy="it can be scaled later")
        for axis, (first, last) in enumerate(zip(low, high, strict=True)):
            if not first < last:
                what = f"the box ends at {last:g} where it begins at {first:g} on axis {axis}"
                raise UsageFault(what, where=where, remedy="give its low corner first, and some extent along every axis")
        return cls(count, curve, node_managed, low, high)


def _location(where: str, value: object) -> Location:
    if not isinstance(value, bytes) or len(value) != LOCATION_BYTES:
        raise UsageFault(f"an offset is a location, {LOCATION_BYTES} bytes", where=where, remedy="give a Location")
    if value == FIRST:
        what = "an offset of 0 is the record's own place, where no copy belongs"
        raise UsageFault(what, where=where, remedy="give another one, or leave it out: it lies where there is most room")
    return Location(value)


def _corners(where: str, box: Box) -> tuple[tuple[float, ...], tuple[float, ...]]:
    try:
        low, high = box
        return as_floats(low), as_floats(high)
    except (TypeError, ValueError) as problem:
        remedy = "give two corners, with one number for each dimension"
        raise UsageFault(f"a box consists of numbers: {problem}", where=where, remedy=remedy) from problem
