"""A space as its scene's log describes it, and what its addresses mean in the world (thesis B.3.1, B.3.3; specs/16-scene-log.md).

    location -> cell -> centre of the cell, in the box of the lattice ("home") -> the log's transforms -> world

A location never changes. A translation or scale changes where it lies in the world, and moves no record: so a box of the
world is carried back to home before it becomes arcs of the line. Contents that hold positions are carried on from the log
position that they were written under (`fast_forward`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias

from scenefold.base.errors import LocalFault
from scenefold.base.ids import SpaceId
from scenefold.base.location import FIRST, Arc, Location
from scenefold.scene.log.affine import Affine
from scenefold.scene.log.growing import Row, grown, items_of, row_of
from scenefold.wire import SpaceEntry

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from scenefold.curve import Lattice

    Points: TypeAlias = npt.NDArray[np.float64]
    Cells: TypeAlias = npt.NDArray[np.uint64]


NO_SPACE = SpaceId(0)


class SpaceFault(LocalFault, ValueError):
    """A position, box or transform that a space has no meaning for."""


class Step(NamedTuple):
    """What the log record at `position` did: a scale by `factor`, or (with factor 1) a translation by `offset`."""

    position: int
    factor: float
    offset: tuple[float, ...]


class CellBox(NamedTuple):
    """Cells first..last along every axis, both included."""

    first: Cells
    last: Cells


@dataclass(frozen=True)
class LoggedSpace:
    """One space. `low` and `high`: the box of the world that its lattice was laid over at its creation."""

    id: SpaceId
    name: str
    dimensions: int
    curve: Literal["hilbert", "z-order"]
    low: tuple[float, ...]
    high: tuple[float, ...]
    transform: Affine
    """Home to world, by all that the log says."""
    node_managed: bool = False
    parent: SpaceId = NO_SPACE
    """Of a shadow: the space whose records it copies."""
    offset: Location = FIRST
    """Of a shadow: how far from a record its copy belongs, around the end of the line."""
    copies: int = 1
    """How many nodes shall hold each record, the owner among them."""
    copies_min: int = 1
    """How many of them must hold it before a write counts as done."""
    render_output: bool = False
    created: int = 1
    """The log position of its creation."""
    turned: int = 0
    """That of the last change of how many copies it has; 0: as it was created (specs/23-turns.md)."""
    steps: Row[Step] = field(default=(), repr=False)

    # ------------------------------------------------------------------------------------------------ transforms

    def stepped(self, step: Step) -> LoggedSpace:
        """The space after one more step."""
        return replace(self, steps=grown(self.steps, step), transform=_after(self.transform, step))

    def placed(self, steps: Sequence[Step]) -> LoggedSpace:
        """The space, which was not moved yet, after all these steps."""
        return replace(self, steps=row_of(steps), transform=self._composed(steps))

    def transform_since(self, position: int) -> Affine:
        """What happened after this log position."""
        return self._composed([step for step in items_of(self.steps) if step.position > position])

    def transform_until(self, position: int) -> Affine:
        """What happened up to this log position, itself included."""
        return self._composed([step for step in items_of(self.steps) if step.position <= position])

    def _composed(self, steps: Iterable[Step]) -> Affine:
        return Affine.identity(self.dimensions).carried_on((step.factor, step.offset) for step in steps)

    @cached_property
    def world_box(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Where the lattice's box lies in the world now."""
        import numpy as np

        low, high = (self.transform.apply(np.asarray(corner)) for corner in (self.low, self.high))
        return tuple(low.tolist()), tuple(high.tolist())

    def fast_forward(self, points: npt.ArrayLike, written_at: int) -> Points:
        """World positions float64[n, D] that a payload held when it was written under a log position, as they are now.

        Directions stay as they are, for a scale is the same along all axes; lengths grow by `transform_since(...).factor`.
        """
        rows = self._rows(points)
        since = self.transform_since(written_at)
        return rows if since.is_identity else since.apply(rows)

    # ------------------------------------------------------------------------------------------------- addresses

    def world_of(self, locations: Sequence[bytes] | npt.NDArray[np.bytes_], at: int | None = None) -> Points:
        """World positions float64[n, D] of the centres of the cells that hold the locations; `at`: as of that log position."""
        transform = self.transform if at is None else self.transform_until(at)
        return transform.apply(self.lattice.centres(self.lattice.curve.decode(locations)))

    def locations_of(self, points: npt.ArrayLike) -> list[Location]:
        """The first location of the cell that each world position lies in; SpaceFault for one outside of the space."""
        curve = self.lattice.curve  # first: where there are no positions, it does not matter how many numbers they have
        rows = self._rows(points)
        low, high = self.world_box
        inside = ((rows >= low) & (rows <= high)).all(axis=1)
        if not inside.all():
            row = rows[int(inside.argmin())].tolist()
            raise SpaceFault(f"the position {_text(row)} lies outside of the space", where=self._where, remedy=self._extent)
        found = curve.encode(self.lattice.cells(self.transform.undo(rows)))
        return [Location.from_padded(location) for location in found.tolist()]

    def cell_box(self, low: Sequence[float], high: Sequence[float]) -> CellBox:
        """The cells that a world box meets. SpaceFault for a box that is none, or that meets no cell."""
        import numpy as np

        lattice = self.lattice  # first, too
        corners = np.stack([self._corner(low), self._corner(high)])
        if (corners[0] > corners[1]).any():
            axis = int(np.argmax(corners[0] > corners[1]))
            what = f"the box ends at {corners[1][axis]:g} before it begins at {corners[0][axis]:g} on axis {axis}"
            raise SpaceFault(what, where=self._where, remedy="give its low corner first")
        world_low, world_high = self.world_box
        if (corners[1] < world_low).any() or (corners[0] > world_high).any():
            raise SpaceFault(f"the box {_text(low)} to {_text(high)} lies outside of the space", where=self._where, remedy=self._extent)
        return CellBox(*lattice.cells(self.transform.undo(corners)))

    def box_arcs(self, low: Sequence[float], high: Sequence[float], limit: int) -> list[Arc]:
        """At most `limit` arcs of the line, ascending, that hold every location in the world box; they may hold others, too."""
        return self.arcs_of(self.cell_box(low, high), limit)

    def arcs_of(self, box: CellBox, limit: int) -> list[Arc]:
        """The same for a box of cells."""
        return [Arc(Location(first), Location(last)) for first, last in self.lattice.curve.arcs(box.first, box.last, limit)]

    def in_cells(self, locations: Sequence[bytes], box: CellBox) -> npt.NDArray[np.bool_]:
        """Which locations lie in cells of the box: bool[n]."""
        import numpy as np

        cells = self.lattice.curve.decode(locations)
        inside: npt.NDArray[np.bool_] = np.all((cells >= box.first) & (cells <= box.last), axis=1)
        return inside

    @cached_property
    def lattice(self) -> Lattice:
        """Cells over the box of the creation. SpaceFault in a space whose places the nodes choose."""
        import numpy as np

        from scenefold.curve import Curve, Lattice

        if self.node_managed:
            raise SpaceFault("the nodes choose the places in this space", where=self._where, remedy="list its records instead")
        return Lattice(Curve(self.curve, self.dimensions), np.asarray(self.low), np.asarray(self.high))

    # ------------------------------------------------------------------------------------------------- arguments

    def _corner(self, corner: Sequence[float]) -> Points:
        import numpy as np

        row = self._numbers("a corner consists of numbers", corner, "give one for each dimension")
        if row.shape != (self.dimensions,):
            count = len(row) if row.ndim == 1 else f"shape {row.shape}"
            what = f"a corner has {self.dimensions} coordinates here, not {count}"
            raise SpaceFault(what, where=self._where, remedy="give one for each dimension")
        if np.isnan(row).any():
            raise SpaceFault("a corner of the box is not a number (NaN)", where=self._where, remedy="inf and -inf mean: without end")
        return row

    def _rows(self, points: npt.ArrayLike) -> Points:
        import numpy as np

        rows = self._numbers("positions are numbers", points, self._extent)
        if rows.ndim != 2 or rows.shape[1] != self.dimensions:
            what = f"positions have {self.dimensions} coordinates here, not shape {rows.shape}"
            raise SpaceFault(what, where=self._where, remedy="give rows, one number for each dimension")
        if np.isnan(rows).any():
            raise SpaceFault("a position is not a number (NaN)", where=self._where, remedy=self._extent)
        return rows

    def _numbers(self, what: str, given: npt.ArrayLike, remedy: str) -> Points:
        import numpy as np

        try:
            return np.asarray(given, np.float64)
        except (TypeError, ValueError, OverflowError) as problem:
            raise SpaceFault(f"{what}: {problem}", where=self._where, remedy=remedy) from problem

    @property
    def _where(self) -> str:
        return f"space {self.name or self.id}"

    @property
    def _extent(self) -> str:
        low, high = self.world_box
        return f"it spans {_text(low)} to {_text(high)}"

    def public(self) -> SpaceEntry:
        """What the public header says of it."""
        offset = self.offset if self.parent else Location.from_number(self.turned)
        return SpaceEntry(self.id, self.parent, offset, self.copies, self.copies_min, self.render_output, self.node_managed)

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        low, high = self.world_box
        return {
            "space": self.id,
            "name": self.name,
            "dimensions": self.dimensions,
            "curve": self.curve,
            "node_managed": self.node_managed,
            "parent": self.parent,
            "copy_offset": self.offset.hex(),
            "copies": self.copies,
            "copies_min": self.copies_min,
            "copies_since": self.turned or self.created,
            "render_output": self.render_output,
            "created": self.created,
            "world_low": list(low),
            "world_high": list(high),
            "factor": self.transform.factor,
            "offset": list(self.transform.offset),
        }


def _after(transform: Affine, step: Step) -> Affine:
    # A scale leaves the offset of its step at 0, a translation the factor at 1: one of the two is nothing.
    return transform.scaled(step.factor) if step.factor != 1.0 else transform.translated(step.offset)


def _text(corner: Sequence[float]) -> str:
    return "(" + ", ".join(f"{float(part):g}" for part in corner) + ")"
