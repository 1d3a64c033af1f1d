"""Reads that take any one node's word, as long as it is not older than what this client has met (specs/20-copies.md, Reads).

For who would rather have something old than nothing: a majority of the nodes may be away, or without leases. Each record is verified like
any other, so what comes was written by somebody who might; but something newer may have been acknowledged since.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

from scenefold.base.errors import DamagedData, PeerFault, Refused, ScenefoldError, Unreachable
from scenefold.base.ids import NodeId
from scenefold.base.limits import CLIENT_GET_KEYS, CLIENT_STATUS_S
from scenefold.base.reasons import RejectReason
from scenefold.client.copy_reads import CopyReads
from scenefold.client.copy_words import is_stray
from scenefold.client.sealing import Opened, open_all
from scenefold.client.split import frames
from scenefold.client.together import together
from scenefold.client.verifying import Key
from scenefold.crypto import wanted_place
from scenefold.wire import DAMAGED_RECORD, CopiesFound, CopyState, GetCopies, GetMany, GetManyReply, RecordBytes, RecordKey

if TYPE_CHECKING:
    from scenefold.client.access import SceneAccess

_UNKNOWN = object()
"""A node cannot say."""


async def any_copies(access: SceneAccess, keys: Sequence[Key]) -> list[Opened | None]:
    """The records at the keys, in order, each from the first node that has it; None where one says that nothing is there.

    If nobody can say of a record: the last error, or Refused (16) if all that there is is older than what was met.
    """
    return await _AnyCopies(access, keys).found()


class _AnyCopies:
    """One such call."""

    def __init__(self, access: SceneAccess, keys: Sequence[Key]) -> None:
        self._access, self._keys = access, keys
        self._reads = CopyReads(access.calls, access.identity.scene, access.identity.layouts)
        self._homes = [wanted_place(key[2]) if len(key) == 3 else key[1] for key in keys]
        self._found: dict[int, Opened | None] = {}
        self._problem: ScenefoldError | None = None

    async def found(self) -> list[Opened | None]:
        await self._access.calls.learn()
        candidates = {index: self._candidates(index) for index in range(len(self._keys))}
        while asked := self._next(candidates):
            await together(partial(self._ask, node, frame) for node, frame in asked)
        if len(self._found) < len(self._keys):
            index = next(index for index in range(len(self._keys)) if index not in self._found)
            raise self._problem or self._older(index)
        return [self._found[index] for index in range(len(self._keys))]

    def _candidates(self, index: int) -> list[NodeId]:
        """Who may have a record: its owner, then who holds copies; who was silent the last time at the end."""
        calls = self._access.calls
        owners = [owner.node_id for owner in calls.table.candidates(self._homes[index])]
        nodes = dict.fromkeys([*owners, *self._reads.holders(self._keys[index][0], self._homes[index])])
        return sorted(nodes, key=calls.is_silent)

    def _next(self, candidates: dict[int, list[NodeId]]) -> list[tuple[NodeId, list[int]]]:
        """Whom to ask for which of those that are not known yet; nobody is asked twice."""
        routed: dict[NodeId, list[int]] = {}
        for index, nodes in candidates.items():
            if index not in self._found and nodes:
                routed.setdefault(nodes.pop(0), []).append(index)
        ones = [1] * len(self._keys)
        return [(node, frame) for node, indices in routed.items() for frame in frames(indices, ones, CLIENT_GET_KEYS)]

    async def _ask(self, node: NodeId, frame: list[int]) -> None:
        """Hear what a node has of these; what it says that cannot be, or is older than what was met, is left to others."""
        while frame:
            asked_at = self._access.setbacks.moment()
            try:
                records = await self._records(node, frame)
            except (Unreachable, Refused, PeerFault) as problem:
                self._problem = problem
                return
            for index, record in zip(frame, records, strict=False):
                if record is not _UNKNOWN:
                    await self._take(index, record, asked_at)  # type: ignore[arg-type]
            frame = frame[len(records) :]

    async def _take(self, index: int, record: RecordBytes | None, asked_at: int) -> None:
        key = self._keys[index]
        try:
            (opened,) = await self._access.understood(open_all, [key], [record])
        except DamagedData as problem:
            self._problem = problem
            return
        if not self._access.setbacks.is_behind(key, opened, asked_at):
            self._access.setbacks.showed(key, opened)
            self._found[index] = opened

    async def _records(self, node: NodeId, frame: Sequence[int]) -> list[RecordBytes | object | None]:
        """What a node says of the first of these."""
        access, calls = self._access, self._access.calls
        scene, position = access.identity.scene, access.identity.position
        keys = tuple(RecordKey(*self._keys[index]) for index in frame)
        address = calls.address_of(node)
        owners = {owner.node_id for index in frame for owner in calls.table.candidates(self._homes[index])}
        async with calls.turn(address):
            if node in owners:
                owned = await calls.ask(address, GetMany(scene, position, keys), GetManyReply, timeout_s=CLIENT_STATUS_S)
                records: list[RecordBytes | object | None] = [_UNKNOWN if one == DAMAGED_RECORD else one for one in owned.records]
            else:
                packet = GetCopies(scene, position, keys, False, True)
                reply = await calls.ask(address, packet, CopiesFound, timeout_s=CLIENT_STATUS_S)
                # Whoever holds copies may have something newer than what lies somewhere as a stray.
                known = (CopyState.RECORD, CopyState.NOTHING)
                records = [copy.record if copy.state in known and not is_stray(reply, copy) else _UNKNOWN for copy in reply.copies]
        if not 1 <= len(records) <= len(frame):
            raise PeerFault(f"{len(records)} records for {len(frame)} keys", where=address)
        return records

    def _older(self, index: int) -> Refused:
        key = self._keys[index]
        where = f"scene {self._access.name}, space {key[0]}, {key[-1].hex()}"
        what = "no node that answers has this record as new as it was already seen"
        return Refused(RejectReason.NOT_READY, what, where=where, remedy="try again once more nodes are there")
