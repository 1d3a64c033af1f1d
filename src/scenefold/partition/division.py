"""Space as the render pools of a job divide it: each pool for itself, among its own nodes (specs/36-render-pools.md). Pure."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate, pairwise
from typing import Any, Self

from scenefold.base.errors import LocalFault, PeerFault
from scenefold.base.limits import POOL_NODES_MAX
from scenefold.partition.dropped import without
from scenefold.partition.value import Partition


@dataclass(frozen=True)
class Division:
    """A partition for each pool, all of one epoch. A pool's nodes follow one another: the first pool has the first places."""

    pools: tuple[Partition, ...]

    def __post_init__(self) -> None:
        fault = _fault(self.pools)
        if fault:
            raise LocalFault(f"no division of space: {fault}")

    @classmethod
    def of(cls, pools: Sequence[Partition], epoch: int) -> Self:
        """These cells, in this epoch."""
        return cls(tuple(one if one.epoch == epoch else one.with_epoch(epoch) for one in pools))

    @property
    def epoch(self) -> int:
        return self.pools[0].epoch

    @cached_property
    def nodes(self) -> int:
        """Places, in all pools."""
        return sum(one.nodes for one in self.pools)

    @cached_property
    def ranges(self) -> tuple[range, ...]:
        """The places of each pool."""
        ends = accumulate((one.nodes for one in self.pools), initial=0)
        return tuple(range(first, end) for first, end in pairwise(ends))

    def pool_at(self, place: int) -> int:
        """Which pool the node at a place is in."""
        return next(number for number, places in enumerate(self.ranges) if place in places)

    def with_epoch(self, epoch: int) -> Self:
        """The same cells in another epoch."""
        return type(self).of(self.pools, epoch)

    def without(self, gone: Collection[int], epoch: int) -> Self:
        """Of all nodes but those at these places, whose places close up: each pool carves up its own, and one of which nobody is left is no more."""
        left = []
        for partition, places in zip(self.pools, self.ranges, strict=True):
            lost = [place - places.start for place in places if place in gone]
            if len(lost) < len(places):
                left.append(without(partition, lost, epoch) if lost else partition)
        if not left:
            raise LocalFault("nobody is left to divide space among")
        return type(self).of(left, epoch)

    def to_document(self) -> dict[str, Any]:
        """As plain values; of one pool, that of its partition."""
        documents = [one.to_document() for one in self.pools]
        return documents[0] if len(documents) == 1 else {"pools": documents}

    @classmethod
    def from_document(cls, document: object) -> Self:
        """What another node sent; PeerFault if it is none."""
        rows: object = [document]
        if isinstance(document, dict) and set(document) == {"pools"}:
            rows = document["pools"]
        if not isinstance(rows, list) or len(rows) > POOL_NODES_MAX:
            raise PeerFault("pools are a list of partitions")
        pools = tuple(map(Partition.from_document, rows))
        fault = _fault(pools)
        if fault:
            raise PeerFault(f"no division of space: {fault}")
        return cls(pools)


def _fault(pools: Sequence[Partition]) -> str:
    """What keeps these from being a division, or ""."""
    if not pools:
        return "there is no pool"
    if len({one.epoch for one in pools}) > 1:
        return "its pools are of several epochs"
    if not pools[0].epoch:
        return "epoch 0 is no division's: rays that no cells have addressed yet say so"
    if sum(one.nodes for one in pools) > POOL_NODES_MAX:
        return f"it is for more than {POOL_NODES_MAX} nodes"
    return ""
