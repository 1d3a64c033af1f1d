"""How many copies of its records a space shall have: arguments checked into what its scene's log is told (specs/16-scene-log.md, Shadows). Pure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

from scenefold.base.arguments import as_whole
from scenefold.base.errors import LocalFault, UsageFault
from scenefold.base.ids import SpaceId
from scenefold.base.limits import COPIES_DEFAULT, COPIES_MAX, COPIES_MIN_DEFAULT
from scenefold.scene.log import Layouts, LoggedSpace, SceneLog, missing_shadows
from scenefold.wire import Batch, CreateSpace, SetCopies


class Copies(NamedTuple):
    """So many nodes shall hold each record, and `least` of them must before a write counts as done."""

    copies: int
    least: int

    @classmethod
    def checked(cls, where: str, copies: object, least: object, was: LoggedSpace | None = None) -> Self:
        """Of arguments; UsageFault for what no space can have. `was`: the space as it is, whose least number stays if none is given."""
        wanted = whole_option(where, "copies", copies)
        if least is None:
            # Who keeps several has said how many must be there; of one copy nothing was to be said.
            before = COPIES_MIN_DEFAULT if was is None or was.copies == 1 else was.copies_min
            needed = min(before, wanted)
        else:
            needed = whole_option(where, "copies_min", least)
        if not 1 <= needed <= wanted <= COPIES_MAX:
            what = f"a space has 1 to {COPIES_MAX} copies, and from 1 to all of them must be there, not {needed} of {wanted}"
            raise UsageFault(
                what,
                where=where,
                remedy="let no more of them be there at least (--min-copies, `copies_min`) than there shall be (--copies, `copies`)",
            )
        return cls(wanted, needed)


BY_DEFAULT = Copies(COPIES_DEFAULT, COPIES_MIN_DEFAULT)
"""Of a new space, those of a new scene among them."""


def new_copies(space: SpaceId, copies: object, least: object) -> Callable[[SceneLog], Batch | SetCopies]:
    """The entry by which a space has so many copies, with the shadows that this takes, once it is known what the log says.

    UsageFault for numbers that cannot be; LocalFault for a shadow, which has no copies of its own.
    """
    where = f"space {space}"
    Copies.checked(where, copies, 1 if least is None else least)

    def entry(log: SceneLog) -> Batch | SetCopies:
        was = log.space(space)
        if was.parent:
            parent = log.space(was.parent)
            what = f"the space {was.name!r} holds the copies of the space {parent.name!r}, and has none of its own"
            raise LocalFault(what, where=where, remedy=f"say how many space {parent.id} shall have")
        wanted = Copies.checked(where, copies, least, was)
        shadows = missing_shadows(was, wanted.copies, log)
        change = SetCopies(space, *wanted)
        return Batch((change, *shadows)) if shadows else change

    return entry


def is_so_already(change: Batch | SetCopies, log: SceneLog) -> bool:
    """Whether an entry of `new_copies` would change nothing of the log that it was made for."""
    if isinstance(change, Batch):
        return False
    space = log.space(change.space)
    return (space.copies, space.copies_min) == (change.copies, change.copies_min)


@dataclass(frozen=True, slots=True)
class CopiesPlan:
    """What a change of a space's copies would do. `records`: how many lie in the space, deleted ones among them."""

    was: LoggedSpace
    copies: int
    copies_min: int
    shadows: tuple[str, ...]
    """Names of those that would be made."""
    records: int
    nodes: int

    @classmethod
    def of(cls, change: Batch | SetCopies, log: SceneLog, records: int, nodes: int) -> Self:
        """`change`: an entry of `new_copies` for this log."""
        said, *made = change.entries if isinstance(change, Batch) else (change,)
        assert isinstance(said, SetCopies)
        shadows = tuple(shadow.name for shadow in made if isinstance(shadow, CreateSpace))
        return cls(log.space(said.space), said.copies, said.copies_min, shadows, records, nodes)

    @property
    def is_change(self) -> bool:
        return bool(self.shadows) or (self.was.copies, self.was.copies_min) != (self.copies, self.copies_min)

    def kept_by(self, copies: int) -> int:
        """On how many nodes a record can lie, if it shall have so many copies."""
        return min(copies, self.nodes)

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        more = self.records * (self.kept_by(self.copies) - self.kept_by(self.was.copies))
        return {
            "dry_run": True,
            "space": self.was.id,
            "name": self.was.name,
            "copies": self.copies,
            "copies_min": self.copies_min,
            "copies_before": self.was.copies,
            "copies_min_before": self.was.copies_min,
            "changes": self.is_change,
            "shadows_to_make": list(self.shadows),
            "records": self.records,
            "nodes": self.nodes,
            "copies_to_make": max(0, more),
            "copies_to_drop": max(0, -more),
        }


def check_no_shadow(layouts: Layouts, space: SpaceId, to_do: str) -> None:
    """UsageFault for a shadow: there is nothing `to_do` in it but for nodes."""
    parent = layouts.parents.get(space)
    if parent is not None:
        remedy = f"{to_do} space {parent}, whose shadow it is"
        raise UsageFault("a shadow holds copies, which are the nodes' to keep", where=f"space {space}", remedy=remedy)


def whole_option(where: str, option: str, value: object) -> int:
    """A whole number, by whatever library; UsageFault for what is none."""
    try:
        return as_whole(value)
    except ValueError as problem:
        raise UsageFault(f"{option} is a whole number: {problem}", where=where) from problem
