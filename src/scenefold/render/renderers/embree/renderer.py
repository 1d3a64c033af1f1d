"""The `embree` renderer: the contract's three parts put together."""

from __future__ import annotations

from typing import Any

from scenefold.partition import Partition
from scenefold.render.arrays import JobNumbers
from scenefold.render.contract import HeldScene, Tracer, TreeBudget
from scenefold.render.renderers.embree import numeric_class
from scenefold.render.renderers.embree.geometry import HeldGeometry
from scenefold.render.renderers.embree.tracer import EmbreeTracer
from scenefold.render.renderers.embree.tree_memory import TreeMemory
from scenefold.render.sum_columns import FULL, SumColumns


class EmbreeScene:
    """Trees over what a node holds, and the tracers that share them."""

    def __init__(self, held: HeldScene, numbers: JobNumbers, partition: Partition, me: int, memory: TreeMemory | None = None) -> None:
        self._held, self._numbers, self._partition, self._me = held, numbers, partition, me
        self._geometry = HeldGeometry(held, memory)

    def tracers(self, count: int) -> list[Tracer]:
        """See `OpenScene`."""
        return self.tracers_in(self._partition, self._me, count)

    def tracers_in(self, partition: Partition, me: int, count: int) -> list[Tracer]:
        """See `MovableScene`."""
        return [EmbreeTracer(self._held.arrays, self._geometry, self._numbers, partition, me) for _ in range(count)]

    def close(self) -> None:
        """See `OpenScene`."""
        self._geometry.close()


class EmbreeRenderer:
    """Spatially partitioned path tracing with Embree; equal bits within its numeric class."""

    deals_paths = True

    def numeric_class(self) -> str:
        """See `Renderer`."""
        return numeric_class.numeric_class()

    def columns(self) -> SumColumns:
        """See `LayeredRenderer`."""
        return FULL

    def open(self, held: HeldScene, numbers: JobNumbers, partition: Partition, me: int) -> EmbreeScene:
        """See `Renderer`."""
        return EmbreeScene(held, numbers, partition, me)

    def budget(self, limit: int) -> TreeMemory:
        """See `BudgetedRenderer`."""
        return TreeMemory(limit)

    def open_within(self, memory: TreeBudget, held: HeldScene, numbers: JobNumbers, partition: Partition, me: int) -> EmbreeScene:
        """See `BudgetedRenderer`."""
        assert isinstance(memory, TreeMemory), "a budget is its renderer's own"
        return EmbreeScene(held, numbers, partition, me, memory)

    def measure(self, held: HeldScene, numbers: JobNumbers, partition: Partition, repetitions: int, rays_max: int) -> dict[str, Any]:
        """See `MeasuredRenderer`."""
        from scenefold.render.renderers.embree.measuring import measure

        return measure(held, numbers, partition, repetitions, rays_max)
