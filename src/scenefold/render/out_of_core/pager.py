"""The trees of cells: built when rays want them, and let go, least recently used first, when others need the room."""

from __future__ import annotations

import ctypes
from collections.abc import Collection

from scenefold.base.errors import LocalFault
from scenefold.render.arrays import JobNumbers, SceneArrays
from scenefold.render.contract import BudgetedRenderer, NoRoomForTrees, OpenScene, TreeBudget
from scenefold.render.out_of_core.cells import BUILT_SHARE, Cells, held_of
from scenefold.render.out_of_core.spill import will_need
from scenefold.scene.tables import SceneTables


class Pager:
    """The open scenes of some cells. One thread at a time opens and closes; scenes that are kept may be traced in meanwhile."""

    def __init__(
        self,
        renderer: BudgetedRenderer,
        tables: SceneTables,
        arrays: SceneArrays,
        numbers: JobNumbers,
        cells: Cells,
        memory: TreeBudget,
    ) -> None:
        self._tables, self._arrays, self._numbers, self._cells = tables, arrays, numbers, cells
        self._renderer = renderer
        self._open: dict[int, OpenScene] = {}
        self.memory = memory
        self.built = 0
        """How often trees were built."""
        self.evicted = 0

    def __contains__(self, cell: int) -> bool:
        return cell in self._open

    def scene(self, cell: int) -> OpenScene:
        """One that is open; it is the most recently used one now."""
        scene = self._open.pop(cell)
        self._open[cell] = scene
        return scene

    def camera_scene(self) -> OpenScene:
        """One without geometry, whose tracers only make camera rays."""
        held = held_of(self._tables, self._arrays, self._cells.shares[0])
        empty = type(held)(self._arrays, (), ())
        return self._renderer.open_within(self.memory, empty, self._numbers, self._cells.partition, 0)

    def fits_beside(self, cell: int, kept: Collection[int]) -> bool:
        """Whether its trees can be built, as far as can be told, when all but the `kept` cells go."""
        kept_bytes = sum(int(BUILT_SHARE * self._cells.peaks[other]) for other in self._open if other in kept)
        return kept_bytes + self._cells.peaks[cell] <= self.memory.limit

    def open(self, cell: int, kept: Collection[int]) -> bool:
        """Build the trees of a cell, and let others go for that, but none that are `kept`. Whether there was room.

        LocalFault if there is not, though nothing is kept.
        """
        while self.memory.held + self._cells.peaks[cell] > self.memory.limit and self._evict(kept):
            continue
        while True:
            try:
                held = held_of(self._tables, self._arrays, self._cells.shares[cell])
                self._open[cell] = self._renderer.open_within(self.memory, held, self._numbers, self._cells.partition, cell)
                self.built += 1
                return True
            except NoRoomForTrees:
                if self._evict(kept):
                    continue
                if kept:
                    return False
                what = f"the trees of one of {len(self._cells.shares)} parts of the scene take more than the {self.memory.limit >> 20} MiB that are left for them"
                raise LocalFault(what, where="memory", remedy="give twice as much") from None

    def ask_for(self, cell: int) -> None:
        """Let the kernel read ahead what the trees of a cell are built from: groups that follow each other along the curve lie so in the files."""
        arrays, sizes = self._arrays, self._tables.groups.triangles
        for first, last in runs(self._cells.shares[cell].groups):
            begin = int(arrays.group_first[first])
            will_need(arrays.triangles, begin, int(arrays.group_first[last]) + int(sizes[last]))
            corners = arrays.triangles[begin]
            ends = arrays.triangles[int(arrays.group_first[last]) + int(sizes[last]) - 1]
            will_need(arrays.vertices, int(corners.min()), int(ends.max()) + 1)

    def close(self) -> None:
        """Let all go."""
        while self._evict(()):
            continue

    def _evict(self, kept: Collection[int]) -> bool:
        """Let the least recently used one go; False if there is none that may."""
        going = next((cell for cell in self._open if cell not in kept), None)
        if going is None:
            return False
        self._open.pop(going).close()
        self.evicted += 1
        give_back()
        return True


def runs(numbers: Collection[int]) -> list[tuple[int, int]]:
    """First and last of each run of whole numbers that follow each other; they ascend."""
    found: list[tuple[int, int]] = []
    for number in numbers:
        if found and found[-1][1] == number - 1:
            found[-1] = found[-1][0], number
        else:
            found.append((number, number))
    return found


def give_back() -> None:
    """What was freed goes to the kernel now, where the C library can be told to."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)
