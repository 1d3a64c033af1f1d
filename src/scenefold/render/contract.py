"""What a renderer is: the contract between a job and the code that finds its light (specs/09-renderer-contract.md).

A renderer is a class without arguments, named by an entry point of the group `scenefold.renderers`. For each
job a node opens it on what the node holds, and gets tracers: one for each thread. A tracer is handed batches of
rays (uint32[n, 9], base/rays.py) in its node's cell, adds to integer sums what they contribute, and gives
back those that leave. It knows no network, no clock and no other node.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import metadata
from typing import Any, Protocol, runtime_checkable

from scenefold.base.errors import LocalFault
from scenefold.partition import Partition
from scenefold.render.arrays import F32, U32, EmptySpace, JobNumbers, SceneArrays
from scenefold.render.layers import columns_of
from scenefold.render.pass_sums import PassSums
from scenefold.render.sum_columns import PLAIN, SumColumns

ENTRY_POINTS = "scenefold.renderers"


@dataclass(frozen=True, slots=True)
class HeldGroup:
    """A group in `SceneArrays`: its number, its prototype and how many triangles it has."""

    group: int
    prototype: int
    triangles: int


@dataclass(frozen=True, slots=True)
class HeldScene:
    """What one node holds for a job."""

    arrays: SceneArrays
    groups: tuple[HeldGroup, ...]
    instances: tuple[tuple[int, int], ...]
    """(instance, prototype) from instance 1 on; matrices are in `arrays`."""


@dataclass(frozen=True, slots=True)
class Advanced:
    """What came of a batch (counts for the ledger: specs/08-passes.md)."""

    leaving: dict[int, U32]
    """By node index, uint32[n, 9]."""
    created: int
    retired: int
    casts: int
    """Rays cast, one a visit of this cell: the node's work."""
    shadow_casts: int
    hits: F32 | None = None
    """[n, 3] places in the world where rays have hit, a sample that is fair to each hit; None: the renderer does not tell."""
    hit_count: int = 0
    """How many hits that is a sample of."""


class Tracer(Protocol):
    """Traces in one thread. Calls come from one thread at a time and must release the GIL while they compute."""

    def generate(self, first_path: int, count: int) -> dict[int, U32]:
        """The camera rays of paths first_path .. first_path + count - 1, by the node that casts them first."""
        ...

    def advance(self, rays: U32, first_path: int, sums: PassSums) -> Advanced:
        """Trace rays of one pass until each has ended or left this cell. `sums` is added to.

        Bits of the sums depend on the rays and the scene alone: not on the batch, the order, or the cell.
        """
        ...


@runtime_checkable
class RoutingTracer(Tracer, Protocol):
    """A tracer whose rays another partition may address anew: cells can move (specs/29-moving-cells.md). No renderer needs to."""

    def route(self, rays: U32) -> dict[int, U32]:
        """Rays of any pass, by the node that casts them next: the owner of the place up to which each is done.

        Called in any thread, also while this tracer is at work in another one.
        """
        ...


@runtime_checkable
class SkippingTracer(RoutingTracer, Protocol):
    """A tracer that can pass rays over cells in which they meet nothing (specs/28-rebalancing.md, Empty space). No renderer needs to."""

    def skip(self, empty: EmptySpace) -> None:
        """Do so from now on; nothing is traced meanwhile."""
        ...


class OpenScene(Protocol):
    """A renderer opened on what a node holds."""

    def tracers(self, count: int) -> list[Tracer]:
        """As many tracers as there are threads."""
        ...

    def close(self) -> None:
        """Free everything; no tracer is used any more."""
        ...


@runtime_checkable
class MovableScene(OpenScene, Protocol):
    """An open scene that answers for another cell, all of which it holds already, without being opened anew. No renderer needs to."""

    def tracers_in(self, partition: Partition, me: int, count: int) -> list[Tracer]:
        """As many tracers as there are threads, in node `me`'s cell of another partition: its index there may be another."""
        ...


class Renderer(Protocol):
    """What an entry point of the group names."""

    def numeric_class(self) -> str:
        """Nodes with equal classes give equal bits; a job is refused by a node of another class."""
        ...

    def open(self, held: HeldScene, numbers: JobNumbers, partition: Partition, me: int) -> OpenScene:
        """Build what tracing needs (trees, tables). Called in a worker thread; LocalFault if it cannot be."""
        ...


@runtime_checkable
class DealingRenderer(Renderer, Protocol):
    """A renderer that has only `RoutingTracer`, so that paths can be dealt among render pools (specs/36-render-pools.md). No renderer needs to be."""

    deals_paths: bool
    """True; one that has no such attribute, or False, stands in one pool unless somebody asks for more."""


@runtime_checkable
class MeasuredRenderer(Renderer, Protocol):
    """A renderer that can also tell how fast it is (`scenectl bench render`). No renderer needs to."""

    def measure(self, held: HeldScene, numbers: JobNumbers, partition: Partition, repetitions: int, rays_max: int) -> dict[str, Any]:
        """Trace a job of one node in this thread and time it; the report's fields are in docs/reference/scenectl.md."""
        ...


class NoRoomForTrees(Exception):
    """What was to be built would take more memory than it may."""


class TreeBudget(Protocol):
    """What the trees of several open scenes may take together, and what they take; bytes."""

    limit: int
    held: int
    most: int
    """The most that they have taken so far."""


@runtime_checkable
class BudgetedRenderer(Renderer, Protocol):
    """A renderer whose memory can be bounded to the byte, for scenes that are larger than that (specs/27-out-of-core.md). No renderer needs to."""

    def budget(self, limit: int) -> TreeBudget:
        """So many bytes for the trees of all scenes that are opened within it."""
        ...

    def open_within(self, memory: TreeBudget, held: HeldScene, numbers: JobNumbers, partition: Partition, me: int) -> OpenScene:
        """As `open`; NoRoomForTrees if the trees of all scenes of this `memory`, one of `budget`, would take more than it allows."""
        ...


@runtime_checkable
class LayeredRenderer(Renderer, Protocol):
    """A renderer that can write more than the plain columns of `PassSums`. No renderer needs to."""

    def columns(self) -> SumColumns:
        """The most that its tracers write; how many they are to write, `advance` sees by the shapes of its `sums`."""
        ...


def deals_paths(renderer: Renderer) -> bool:
    """Whether paths can be dealt among pools of nodes with this renderer."""
    return isinstance(renderer, DealingRenderer) and renderer.deals_paths


def check_layers_written(renderer: Renderer, layers: Sequence[str]) -> None:
    """LocalFault if some of these layers need columns that the renderer does not write."""
    written = renderer.columns() if isinstance(renderer, LayeredRenderer) else PLAIN
    missing = [name for name in layers if not columns_of((name,)).within(written)]
    if missing:
        what = f"the renderer does not make the layer{'s' if len(missing) > 1 else ''} {', '.join(missing)}"
        raise LocalFault(what, where="layers", remedy="leave them out")


def load_renderer(name: str) -> Renderer:
    """The installed renderer of this name; LocalFault if there is none."""
    for entry in metadata.entry_points(group=ENTRY_POINTS, name=name):
        renderer: Renderer = entry.load()()
        return renderer
    known = sorted(entry.name for entry in metadata.entry_points(group=ENTRY_POINTS))
    raise LocalFault(f"there is no renderer {name!r}", remedy=f"install it, or choose one of: {', '.join(known) or 'none'}")
