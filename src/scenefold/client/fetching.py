"""Many records from many nodes at once: split by owner, in frames, in parallel, until each has its answer (specs/18-data.md, Reads).

Owners are asked, and, where they are slow, or away, or have far more of it than others, also who holds copies (copy_reads.py).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from scenefold.base.errors import PeerFault, Refused
from scenefold.base.ids import NodeId, SceneId
from scenefold.base.limits import CLIENT_GET_KEYS, CLIENT_REQUEST_S, CLIENT_STATUS_S
from scenefold.base.reasons import RejectReason
from scenefold.client.calls import Calls
from scenefold.client.copy_reads import CopyReads, Wanted
from scenefold.client.delivery import rounds
from scenefold.client.seeking import Search
from scenefold.client.split import frames
from scenefold.client.verifying import Key
from scenefold.crypto import wanted_place
from scenefold.wire import DAMAGED_RECORD, GetMany, GetManyReply, RecordBytes, RecordKey

_MISSING = object()


async def fetch(
    calls: Calls, scene: SceneId, position: int, keys: Sequence[Key], *, stale_ok: bool, copies: CopyReads | None = None
) -> list[RecordBytes | None]:
    """The records at the keys, unverified, in order; None where the owner says that nothing is there.

    DAMAGED_RECORD where it has one that has rotted. `copies`: who else may be asked, where the owner is slow, or away, or has one that has.

    `stale_ok`: take an answer of a node that may have been replaced without knowing, too.
    """
    return await _Fetch(calls, scene, position, keys, stale_ok, copies).run()


class _Fetch:
    """One such call."""

    def __init__(self, calls: Calls, scene: SceneId, position: int, keys: Sequence[Key], stale_ok: bool, copies: CopyReads | None) -> None:
        self._calls, self._scene, self._position, self._keys = calls, scene, position, keys
        self._stale_ok = stale_ok
        self._copies = copies
        self._found: list[RecordBytes | object | None] = [_MISSING] * len(keys)
        self._homes = [wanted_place(key[2]) if len(key) == 3 else key[1] for key in keys]
        self._search = Search(calls, self._homes)

    async def run(self) -> list[RecordBytes | None]:
        copies = self._copies
        wanted = Wanted(self._keys, self._homes, self._position, self._take, self._is_here)
        ask = self._ask_owner if copies is None else partial(copies.beside, self._ask_owner, wanted)
        await rounds(self._calls, self._search, self._pending, self._parts, ask)
        if copies is not None and DAMAGED_RECORD in self._found:
            await copies.instead(wanted, [index for index, record in enumerate(self._found) if record == DAMAGED_RECORD])
        return self._found  # type: ignore[return-value]

    def _is_contested(self, index: int) -> bool:
        return len(self._calls.to_ask(self._homes[index])) > 1

    async def _ask_owner(self, node: NodeId, frame: list[int]) -> None:
        address = self._calls.address_of(node)
        # One that hangs must not hold up what another one that may have the place can answer.
        timeout_s = CLIENT_STATUS_S if self._is_contested(frame[0]) else CLIENT_REQUEST_S
        while frame:
            packet = GetMany(self._scene, self._position, tuple(RecordKey(*self._keys[index]) for index in frame))
            async with self._calls.turn(address):
                reply = await self._calls.ask(address, packet, GetManyReply, timeout_s=timeout_s)
            if not 1 <= len(reply.records) <= len(frame):
                raise PeerFault(f"{len(reply.records)} records for {len(frame)} keys", where=address)
            if reply.stale and not self._stale_ok:
                raise stale_answer(address)
            for index, record in zip(frame, reply.records, strict=False):
                self._found[index] = record
            frame = frame[len(reply.records) :]

    def _parts(self, pending: list[int]) -> list[tuple[NodeId, list[int]]]:
        ones = [1] * len(self._keys)
        # Apart, so that the little time for a contested place is not all that the others have.
        halves = [[index for index in pending if self._is_contested(index) == contested] for contested in (False, True)]
        routed = [part for half in halves for part in self._search.routed(half).items()]
        return [(node, frame) for node, indices in routed for frame in frames(indices, ones, CLIENT_GET_KEYS)]

    def _pending(self) -> list[int]:
        return [index for index, record in enumerate(self._found) if record is _MISSING]

    def _is_here(self, index: int) -> bool:
        return self._found[index] not in (_MISSING, DAMAGED_RECORD)

    def _take(self, index: int, record: RecordBytes | None) -> None:
        if not self._is_here(index):
            self._found[index] = record


def stale_answer(address: str) -> Refused:
    """The error for an answer that an owner without a lease gave."""
    remedy = "try again in a while; if it lasts, the cluster's voter cannot be reached"
    return Refused(RejectReason.NOT_READY, "the answer may be stale: the node holds no lease just now", where=address, remedy=remedy)
