"""Many records from many nodes at once: split by owner, in frames, in parallel, until each has its answer (specs/18-data.md, Reads).

Owners are asked, and, where they are slow, or away, or have far more of it than others, also who holds copies (copy_reads.py).
"""

from __future__ import annotations

from collections.abc import Sequence

from scenefold.base.errors import PeerFault, Refused
from scenefold.base.ids import NodeId, SceneId
from scenefold.base.limits import CLIENT_GET_KEYS, CLIENT_PART_BYTES, CLIENT_PART_RECORDS, CLIENT_REQUEST_S, CLIENT_STATUS_S
from scenefold.base.reasons import RejectReason
from scenefold.client.calls import Calls
from scenefold.client.copy_reads import CopyReads, Wanted
from scenefold.client.delivery import rounds
from scenefold.client.seeking import Search
from scenefold.client.shares import crowded
from scenefold.client.split import frames
from scenefold.client.verifying import Key
from scenefold.crypto import wanted_place
from scenefold.wire import DAMAGED_RECORD, GetMany, GetManyReply, RecordBytes, RecordKey

_MISSING = object()


async def fetch(
    calls: Calls, scene: SceneId, position: int, keys: Sequence[Key], *, stale_ok: bool, copies: CopyReads | None = None, floor: int = 0
) -> list[RecordBytes | None]:
    """The records at the keys, unverified, in order; None where the owner says that nothing is there.

    DAMAGED_RECORD where it has one that has rotted. `copies`: who else may be asked, where the owner is slow, or away, or has one that has.

    `stale_ok`: take an answer of a node that may have been replaced without knowing, too. `floor`: none of one with a lower write floor.
    """
    return await _Fetch(calls, scene, position, keys, stale_ok, copies, floor).run()


class _Fetch:
    """One such call."""

    def __init__(
        self, calls: Calls, scene: SceneId, position: int, keys: Sequence[Key], stale_ok: bool, copies: CopyReads | None, floor: int
    ) -> None:
        self._calls, self._scene, self._position, self._keys = calls, scene, position, keys
        self._stale_ok, self._floor = stale_ok, floor
        self._copies = copies
        self._found: list[RecordBytes | object | None] = [_MISSING] * len(keys)
        self._homes = [wanted_place(key[2]) if len(key) == 3 else key[1] for key in keys]
        self._wanted = Wanted(keys, self._homes, position, self._take, self._is_here, self._record)
        self._search = Search(calls, self._homes)
        # Of what is nowhere else nobody can help an owner.
        self._is_elsewhere = copies is not None and all(copies.layouts.offsets.get(space) for space in {key[0] for key in keys})
        self._crowded: set[NodeId] = set()
        """Owners that have far more of it than others."""

    async def run(self) -> list[RecordBytes | None]:
        copies, wanted = self._copies, self._wanted
        await rounds(self._calls, self._search, self._pending, self._parts, self._ask)
        if copies is not None and DAMAGED_RECORD in self._found:
            await copies.instead(wanted, [index for index, record in enumerate(self._found) if record == DAMAGED_RECORD])
        if copies is not None and self._keys:
            await copies.tell(wanted)
            copies.usual.saw(wanted.keys[0][0], [len(record.ciphertext) for record in self._found if isinstance(record, RecordBytes)])
        return self._found  # type: ignore[return-value]

    @property
    def _part_records(self) -> int:
        """So many records are worth a request of their own."""
        usual = 0 if self._copies is None or not self._keys else self._copies.usual.count(self._keys[0][0], CLIENT_PART_BYTES)
        return max(CLIENT_PART_RECORDS, min(CLIENT_GET_KEYS, usual))

    def _is_contested(self, index: int) -> bool:
        return len(self._calls.to_ask(self._homes[index])) > 1

    async def _ask(self, node: NodeId, frame: list[int]) -> None:
        copies = self._copies
        if copies is None:
            await self._ask_owner(node, frame)
        elif node in self._crowded and not self._is_contested(frame[0]):
            await copies.wide(self._ask_once, self._wanted, node, frame, self._part_records)
        else:
            await copies.beside(self._ask_owner, self._wanted, node, frame)

    async def _ask_owner(self, node: NodeId, frame: list[int]) -> None:
        while frame:
            async with self._calls.turn(self._calls.address_of(node), len(frame)):
                frame = frame[await self._ask_once(node, frame) :]

    async def _ask_once(self, node: NodeId, frame: list[int]) -> int:
        """How many of the first of them were answered for."""
        address = self._calls.address_of(node)
        # One that hangs must not hold up what another one that may have the place can answer.
        timeout_s = CLIENT_STATUS_S if self._is_contested(frame[0]) else CLIENT_REQUEST_S
        packet = GetMany(self._scene, self._position, tuple(RecordKey(*self._keys[index]) for index in frame))
        reply = await self._calls.ask(address, packet, GetManyReply, timeout_s=timeout_s)
        if not 1 <= len(reply.records) <= len(frame):
            raise PeerFault(f"{len(reply.records)} records for {len(frame)} keys", where=address)
        if reply.stale and not self._stale_ok:
            raise stale_answer(address)
        if reply.write_floor < self._floor:
            raise late_answer(address)
        for index, record in zip(frame, reply.records, strict=False):
            self._found[index] = record
        return len(reply.records)

    def _parts(self, pending: list[int]) -> list[tuple[NodeId, list[int]]]:
        ones = [1] * len(self._keys)
        # Apart, so that the little time for a contested place is not all that the others have.
        contested = self._search.routed([index for index in pending if self._is_contested(index)])
        routed = self._search.routed([index for index in pending if not self._is_contested(index)])
        owning = sum(owner.right_bound is not None for owner in self._calls.table.owners)
        counts = {node: len(indices) for node, indices in routed.items()}
        self._crowded = crowded(counts, owning, 2 * self._part_records) if self._is_elsewhere else set()
        wide = [(node, part) for node in self._crowded for part in frames(routed.pop(node), ones, len(self._keys))]
        others = [*contested.items(), *routed.items()]
        return [*wide, *((node, frame) for node, indices in others for frame in frames(indices, ones, CLIENT_GET_KEYS))]

    def _pending(self) -> list[int]:
        return [index for index, record in enumerate(self._found) if record is _MISSING]

    def _is_here(self, index: int) -> bool:
        return self._found[index] not in (_MISSING, DAMAGED_RECORD)

    def _record(self, index: int) -> RecordBytes | None:
        found = self._found[index]
        return found if isinstance(found, RecordBytes) else None

    def _take(self, index: int, record: RecordBytes | None) -> None:
        if not self._is_here(index):
            self._found[index] = record


def late_answer(address: str) -> Refused:
    """The error for an answer by a header of before the render mode: whoever gave it may still take edits."""
    what = "the node does not know yet that the scene is in render mode"
    return Refused(
        RejectReason.NOT_READY, what, where=address, remedy="try again in a while; if it lasts, it cannot reach who decides the scene"
    )


def stale_answer(address: str) -> Refused:
    """The error for an answer that an owner without a lease gave."""
    remedy = "try again in a while; if it lasts, the cluster's voter cannot be reached"
    return Refused(RejectReason.NOT_READY, "the answer may be stale: the node holds no lease just now", where=address, remedy=remedy)
