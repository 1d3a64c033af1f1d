"""What a new space shall be: arguments checked into the entry that creates it (specs/16-scene-log.md, CreateSpace)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TypedDict

from scenefold.base.errors import LocalFault
from scenefold.base.ids import SpaceId
from scenefold.base.limits import SPACE_DIMENSIONS_MAX, SPACE_NAME_BYTES_MAX
from scenefold.base.location import FIRST
from scenefold.curve import CurveKind
from scenefold.scene.log import SceneLog
from scenefold.wire import CreateSpace
from scenefold.wire import CurveKind as CurveNumber

_NUMBERS = {"hilbert": CurveNumber.HILBERT, "z-order": CurveNumber.Z_ORDER}


class SpaceOptions(TypedDict, total=False):
    """All that a space may be told beside its name and box."""

    dimensions: int
    """1 to 8; by default 3, or as many as the box has."""
    curve: CurveKind
    """hilbert, or z-order."""
    node_managed: bool
    """The nodes choose where records lie, and take them along when bounds move."""
    render_output: bool
    """May be written while the scene is being rendered."""
    space_id: int
    """By default the next one that was never used."""


def new_space(
    name: str,
    box: tuple[Sequence[float], Sequence[float]] | None = None,
    *,
    dimensions: int | None = None,
    curve: CurveKind = "hilbert",
    node_managed: bool = False,
    render_output: bool = False,
    space_id: int | None = None,
) -> Callable[[SceneLog], CreateSpace]:
    """The entry that creates the space, once it is known which number is free. LocalFault for what cannot be."""
    where = f"space {name[:SPACE_NAME_BYTES_MAX]}"
    if not name or len(name.encode("utf-8", "surrogatepass")) > SPACE_NAME_BYTES_MAX or not name.isprintable() or name.isdecimal():
        remedy = f"use 1 to {SPACE_NAME_BYTES_MAX} printable characters, not all of them digits"
        raise LocalFault(f"{name[:SPACE_NAME_BYTES_MAX]!r} cannot be the name of a space", where="space name", remedy=remedy)
    if curve not in _NUMBERS:
        raise LocalFault(f"there is no curve {curve!r}", where=where, remedy="use hilbert or z-order")
    count = dimensions if dimensions is not None else 3 if box is None else len(box[0])
    if not 1 <= count <= SPACE_DIMENSIONS_MAX:
        raise LocalFault(
            f"a space has 1 to {SPACE_DIMENSIONS_MAX} dimensions, not {count}",
            where=where,
            remedy="choose as many as positions have coordinates",
        )
    low, high = ((0.0,) * count, (1.0,) * count) if box is None else (tuple(map(float, corner)) for corner in box)
    if not len(low) == len(high) == count:
        what = f"a corner of the box has {count} coordinates, not {len(low)} and {len(high)}"
        raise LocalFault(what, where=where, remedy="give one for each dimension")
    if not all(map(math.isfinite, (*low, *high))):
        raise LocalFault("the box of a space is finite", where=where, remedy="it can be scaled later")
    for axis, (first, last) in enumerate(zip(low, high, strict=True)):
        if not first < last:
            what = f"the box ends at {last:g} where it begins at {first:g} on axis {axis}"
            raise LocalFault(what, where=where, remedy="give its low corner first, and some extent along every axis")

    def entry(log: SceneLog) -> CreateSpace:
        return CreateSpace(
            space=log.free_id() if space_id is None else SpaceId(space_id),
            dimensions=count,
            curve=_NUMBERS[curve],
            node_managed=node_managed,
            parent=SpaceId(0),
            offset=FIRST,
            copies=1,
            copies_min=1,
            render_output=render_output,
            name=name,
            low=low,
            high=high,
        )

    return entry
