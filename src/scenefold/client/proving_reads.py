"""What single nodes have on their disks, with bytes: their own records, and copies that they hold (specs/20-copies.md, Health).

A read at a node that does not own a place is passed on to its owner. So who answers as an owner is asked what it owns behind that: only then
it is its own disk that was read, or it has claimed the place since, and claims nothing that it does not have.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from typing import NamedTuple, TypeAlias

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId
from scenefold.base.limits import CLIENT_STATUS_S
from scenefold.base.location import FIRST, Arc
from scenefold.client.calls import Calls
from scenefold.client.copy_words import is_stray
from scenefold.client.proof import Verdict
from scenefold.client.proving_scenes import ShownScene
from scenefold.client.reencryption import Pace
from scenefold.client.verifying import Key
from scenefold.wire import (
    DAMAGED_RECORD,
    CopiesFound,
    Copy,
    CopyState,
    GetCopies,
    GetMany,
    GetManyReply,
    RecordBytes,
    RecordKey,
    RequestTable,
    RespondTable,
)
from scenefold.world import Priority

READ_S = 20.0
"""For what a node answers at a time, 4 MiB at most."""
SILENT_S = 30.0
"""Who did not answer is let alone for so long."""


class Stray(NamedTuple):
    """A record that lies at a node by no right: it is to be brought home."""

    record: RecordBytes


Said: TypeAlias = RecordBytes | Stray | Verdict | None
"""A record; or nothing, corrupt, silent. None: the node is none of those who hold it."""


class NodeReads:
    """`silent`: nodes that are known not to answer."""

    def __init__(self, calls: Calls, pace: Pace, silent: Sequence[NodeId] = ()) -> None:
        self._calls = calls
        self._pace = pace
        self._silent_until = dict.fromkeys(silent, calls.world.clock.now() + SILENT_S)
        self.bytes = 0

    def is_silent(self, node: NodeId) -> bool:
        return self._silent_until.get(node, float("-inf")) > self._calls.world.clock.now()

    def fell_silent(self, node: NodeId) -> None:
        self._silent_until[node] = self._calls.world.clock.now() + SILENT_S

    async def owned(self, node: NodeId, scene: ShownScene, keys: Sequence[Key]) -> tuple[list[Said], Arc | None]:
        """What an owner has of these; and what it owns, as it says once it has answered. None: it owns nothing, or does not say."""

        async def ask(left: Sequence[Key]) -> list[Said]:
            packet = GetMany(scene.scene, scene.position, tuple(RecordKey(*key) for key in left))
            reply = await self._calls.ask(self._calls.address_of(node), packet, GetManyReply, timeout_s=READ_S)
            return [_as_said(record) for record in reply.records]

        said = await self._all(node, keys, ask)
        return said, await self._arc_of(node)

    async def held(self, node: NodeId, scene: ShownScene, keys: Sequence[Key]) -> list[Said]:
        """What a holder has of these."""

        async def ask(left: Sequence[Key]) -> list[Said]:
            packet = GetCopies(scene.scene, scene.position, tuple(RecordKey(*key) for key in left), digests_only=False, any_copy=True)
            reply = await self._calls.ask(self._calls.address_of(node), packet, CopiesFound, timeout_s=READ_S)
            return [_of_copy(reply, copy) for copy in reply.copies]

        return await self._all(node, keys, ask)

    async def _all(self, node: NodeId, keys: Sequence[Key], ask: Callable[[Sequence[Key]], Awaitable[list[Said]]]) -> list[Said]:
        """In parts that fit an answer. Of a node that does not answer, or only with nonsense, all that is left is silent."""
        found: list[Said] = []
        while len(found) < len(keys) and not self.is_silent(node):
            left = keys[len(found) :]
            try:
                async with self._calls.turn(self._calls.address_of(node)):
                    part = await ask(left)
            except Unreachable:
                self.fell_silent(node)
                break
            except (Refused, PeerFault):
                break
            if not 1 <= len(part) <= len(left):
                break
            found += part
            await self._count(sum(len(record.ciphertext) for record in map(record_of, part) if record is not None))
        return [*found, *[Verdict.SILENT] * (len(keys) - len(found))]

    async def _count(self, size: int) -> None:
        self.bytes += size
        wait_s = self._pace.wait_s(self._calls.world.clock.now(), size)
        if wait_s > 0:
            await self._calls.world.clock.sleep(wait_s)

    async def _arc_of(self, node: NodeId) -> Arc | None:
        try:
            reply = await self._calls.ask(
                self._calls.address_of(node), RequestTable(), RespondTable, priority=Priority.HIGH, timeout_s=CLIENT_STATUS_S
            )
        except (Unreachable, Refused, PeerFault):
            return None
        own = next((status for status in reply.statuses if status.node == node), None)
        if own is None or own.right_bound is None:
            return None
        first = FIRST if own.left_fence is None else own.left_fence.next()
        return None if first is None or first > own.right_bound else Arc(first, own.right_bound)


def record_of(said: Said) -> RecordBytes | None:
    """What a node has shown, wherever it belongs."""
    return said.record if isinstance(said, Stray) else said if isinstance(said, RecordBytes) else None


def _as_said(record: RecordBytes | None) -> Said:
    if record is None:
        return Verdict.NOTHING
    return Verdict.CORRUPT if record == DAMAGED_RECORD else record


def _of_copy(reply: CopiesFound, copy: Copy) -> Said:
    match copy.state:
        case CopyState.NO_CUSTODY:
            return None
        case CopyState.RECORD if copy.record is not None:
            return Stray(copy.record) if is_stray(reply, copy) else copy.record
        case CopyState.DAMAGED:
            return Verdict.CORRUPT
        case _:
            # A digest is no record, whoever has asked for what.
            return Verdict.NOTHING
