"""What reads and writes must know about copies, where a space has more than one: a small protocol, kept by replication.

A record of such a space counts once enough nodes have it. Until then it is *unsettled*, and nobody is told of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol

from scenefold.base.errors import DamagedData
from scenefold.base.ids import NodeId, SceneId, SpaceId
from scenefold.base.location import Arc
from scenefold.base.reasons import RejectReason
from scenefold.crypto import Record
from scenefold.peer.records.verification import KnownScene
from scenefold.store import Put, PutResult, Spot, Store

TOLD_S_MAX = 2.0
"""How long whoever would tell of what is unsettled waits. Then it is told without a lease, or not at all."""


class NotKept(NamedTuple):
    """A record that cannot be acknowledged, or an answer that cannot be given, now.

    `node`: this node if nothing was stored, else one that lacks it (0: nobody knows). With TOO_FEW_COPIES nothing was stored: this node if too
    few nodes may hold copies, else one that may and is not there.
    """

    reason: RejectReason
    node: NodeId


class Copying(Protocol):
    """How a node's own records come to those who hold copies of them. Times are Trio's."""

    async def put(self, puts: Sequence[Put], scenes: Mapping[SceneId, KnownScene], /) -> Sequence[PutResult | NotKept]:
        """Like `Store.put`, within the gate; returns once all of them are settled, or will not be soon."""
        ...

    async def records_settled(self, spots: Sequence[Spot], found: Sequence[Record | DamagedData | None], until: float, /) -> bool:
        """Whether these records, which were read there just now, may be told; waits for that until then."""
        ...

    async def list_settled(self, scene: SceneId, space: SpaceId, arc: Arc, until: float, /) -> bool:
        """Whether a list of that part of the arc, which was made just now, may be told; waits for that until then."""
        ...


class OneCopy:
    """That of a node which holds the only copy of everything."""

    def __init__(self, store: Store) -> None:
        self._store = store

    async def put(self, puts: Sequence[Put], _scenes: Mapping[SceneId, KnownScene], /) -> Sequence[PutResult | NotKept]:
        return await self._store.put(puts)

    async def records_settled(self, _spots: Sequence[Spot], _found: Sequence[Record | DamagedData | None], _until: float, /) -> bool:
        return True

    async def list_settled(self, _scene: SceneId, _space: SpaceId, _arc: Arc, _until: float, /) -> bool:
        return True
