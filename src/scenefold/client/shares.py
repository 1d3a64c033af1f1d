"""Which of some records are asked of whom next, where several have them (specs/20-copies.md, Reads). Pure.

Nobody is given a fixed part: who is ready takes the next few, so a slow one takes fewer. What one has taken and does not bring for long,
another one that has nothing left to do takes as well. What one cannot give, or gives wrong, is asked of the next.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice

from scenefold.base.ids import NodeId, SpaceId


@dataclass(slots=True)
class _Record:
    sources: Sequence[NodeId]
    asked: dict[NodeId, float] = field(default_factory=dict)
    """Who was asked for it, and when."""
    out: set[NodeId] = field(default_factory=set)
    """Of these, who may still bring it."""


class Shares:
    """Of one question. `sources`: of each record, by number, who may have it."""

    def __init__(self, sources: Mapping[int, Sequence[NodeId]], least: int, most: int) -> None:
        """`least`, `most`: so many records are asked for at a time, if there are as many."""
        self._free = {index: _Record(nodes) for index, nodes in sources.items()}
        """Those that nobody is being asked for."""
        self._out: dict[int, _Record] = {}
        """The others, those that were asked for first at the front."""
        self.nodes = list(dict.fromkeys(node for nodes in sources.values() for node in nodes))
        self._least, self._most = least, most

    def next_of(self, node: NodeId, now: float) -> list[int]:
        """What a node that is ready is asked for, and nobody else yet. Less as the end comes nearer, so that all end together."""
        count = min(self._most, max(self._least, len(self._free) // (2 * len(self.nodes))))
        return self._taken(list(islice(self._askable(self._free, node), count)), node, now)

    def late_of(self, node: NodeId, now: float, patience_s: float) -> list[int]:
        """What others were asked for so long ago that this one, which is ready, is asked as well."""
        return self._taken(list(islice(self._late(node, now, patience_s), self._least)), node, now)

    def is_wanted_of(self, node: NodeId, now: float, patience_s: float) -> bool:
        """Whether one of these two has anything."""
        return any(True for _ in self._askable(self._free, node)) or any(True for _ in self._late(node, now, patience_s))

    def came(self, index: int) -> None:
        """It is here."""
        self._free.pop(index, None)
        self._out.pop(index, None)

    def ended(self, node: NodeId, indices: Sequence[int]) -> None:
        """The node has answered for these, or failed; what of them has not come it is not asked for again."""
        for index in indices:
            record = self._out.get(index)
            if record is not None:
                record.out.discard(node)
                if not record.out:
                    self._free[index] = self._out.pop(index)

    def only_of(self, node: NodeId, index: int) -> None:
        """What others give of it is of no use."""
        record = self._free.get(index) or self._out.get(index)
        if record is not None:
            record.sources = (node,)

    def may_help(self, node: NodeId) -> bool:
        """Whether there is anything that this node could still be asked for."""
        return any(True for left in (self._free, self._out) for _ in self._askable(left, node))

    @property
    def left(self) -> list[int]:
        """What has not come."""
        return [*self._free, *self._out]

    @property
    def is_over(self) -> bool:
        """Everything has come."""
        return not self._free and not self._out

    def _askable(self, records: Mapping[int, _Record], node: NodeId) -> Iterator[int]:
        return (index for index, record in records.items() if node in record.sources and node not in record.asked)

    def _late(self, node: NodeId, now: float, patience_s: float) -> Iterator[int]:
        for index in self._askable(self._out, node):
            if max(self._out[index].asked.values()) <= now - patience_s:
                yield index

    def _taken(self, indices: list[int], node: NodeId, now: float) -> list[int]:
        for index in indices:
            record = self._free.pop(index, None) or self._out.pop(index)
            record.asked[node] = now
            record.out.add(node)
            self._out[index] = record
        return indices


def crowded(counts: Mapping[NodeId, int], nodes: int, least: int) -> set[NodeId]:
    """The owners that have far more of one call than others: `least`, and twice what would fall to each of so many nodes."""
    fair = sum(counts.values()) / max(1, nodes)
    return {owner for owner, count in counts.items() if count >= least and count > 2 * fair}


class UsualBytes:
    """How large the records of each space were lately."""

    def __init__(self, unknown: float) -> None:
        self._unknown = unknown
        self._usual: dict[SpaceId, float] = {}

    def saw(self, space: SpaceId, sizes: Sequence[int]) -> None:
        """So large were those of one call: half of what counts."""
        if not sizes:
            return
        mean = sum(sizes) / len(sizes)
        self._usual[space] = (self._usual.get(space, mean) + mean) / 2

    def count(self, space: SpaceId, size: int) -> int:
        """About so many of them have that size together."""
        return int(size / max(1.0, self._usual.get(space, self._unknown)))
