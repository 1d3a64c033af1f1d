"""Much that lies with one owner is read from it and from those who hold copies at once (specs/20-copies.md, Reads).

The owner says which versions count, as little as that is; the bytes come from whoever is ready (shares.py). What a holder gives counts
once the version that it is of does, so nothing is older than the owner's word. What does not fit is asked of the next one.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from functools import partial
from typing import TYPE_CHECKING

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId
from scenefold.base.limits import CLIENT_FRAMES_PER_NODE, CLIENT_GET_KEYS
from scenefold.base.reasons import RejectReason
from scenefold.client.asked_holders import AskedHolders, ask_copies
from scenefold.client.copy_words import NOTHING, word_of
from scenefold.client.hedging import helped
from scenefold.client.shares import Shares
from scenefold.crypto import version_of
from scenefold.wire import RecordBytes
from scenefold.world import background_tasks

if TYPE_CHECKING:
    from scenefold.client.copy_reads import CopyReads, Wanted

AskOnce = Callable[[NodeId, list[int]], Awaitable[int]]
"""Ask an owner for some records, in one request: it has answered for so many of the first of them."""
MUCH = 8
"""Parts of every node, from which on it is worth having one on the way while another one is worked on."""


class WideRead:
    """Of one owner's records of one call."""

    def __init__(self, reads: CopyReads, ask_once: AskOnce, wanted: Wanted, owner: NodeId, frame: list[int], least: int) -> None:
        """`least`: so many of them are worth a request."""
        self._reads = reads
        self._calls = reads.calls
        self._ask_once = ask_once
        self._wanted = wanted
        self._owner = owner
        self._frame = frame
        self._least = least
        self._groups = reads.groups(wanted, frame)
        holders = {index: nodes for nodes, indices in self._groups.items() for index in indices}
        self._shares = Shares({index: (owner, *holders.get(index, ())) for index in frame}, least, CLIENT_GET_KEYS)
        self._versions: dict[int, bytes] = {}
        self._knows_versions = False
        self._unsure: dict[int, tuple[NodeId, RecordBytes | None]] = {}
        """What a holder gave, None for nothing, before it was known which version counts."""
        self._problem: Unreachable | Refused | PeerFault | None = None
        self._working = 0
        self._change = trio.Event()

    async def run(self) -> None:
        """Return once all of it is here. What the owner's trouble is, is raised if others cannot help either."""
        async with background_tasks() as nursery:
            # Of little, a slow one shall not have two parts before others have had their second.
            is_much = len(self._frame) >= MUCH * self._least * len(self._shares.nodes)
            at_a_time = CLIENT_FRAMES_PER_NODE if is_much else 1
            workers = [partial(self._work, node) for node in self._shares.nodes for _ in range(at_a_time)]
            tasks: list[Callable[[], Awaitable[object]]] = [self._learn_versions, *workers]
            for task in tasks:
                self._working += 1
                nursery.start_soon(self._counted, task)
            while self._working and not self._shares.is_over:
                await self._change.wait()
        if not self._shares.is_over and self._problem is not None:
            # Who was not among those that were thought to hold copies may have them.
            await self._reads.instead(self._wanted, self._shares.left)
            if not all(map(self._wanted.is_here, self._shares.left)):
                raise self._problem

    async def _counted(self, task: Callable[[], Awaitable[object]]) -> None:
        await task()
        self._working -= 1
        self._changed()

    # ------------------------------------------------------------------------------------------------------ versions

    async def _learn_versions(self) -> None:
        """By the owner's word; if it is slow or away, by that of enough holders."""
        holders = AskedHolders(self._reads, self._wanted)
        try:
            await helped(
                self._ask_versions,
                partial(holders.ask, self._groups, versions_only=True),
                after_s=self._reads.patience_s(self._owner, 1),
                others_know=lambda: all(holders.version(index) is not None for index in self._frame),
            )
        except (Unreachable, Refused, PeerFault) as problem:
            # It may still give records: that is as good.
            self._problem = self._problem or problem
        for index in self._frame:
            version = self._versions.get(index, holders.version(index))
            if version is None:
                self._shares.only_of(self._owner, index)
            else:
                self._versions[index] = version
        self._knows_versions = True
        for index, (node, record) in list(self._unsure.items()):
            self._judge(index, node, record)
        for index, version in self._versions.items():
            if version == NOTHING:
                self._come(index, None)

    async def _ask_versions(self) -> None:
        left = list(self._frame)
        while left:
            reply = await ask_copies(self._reads, self._wanted, self._owner, left, digests_only=True)
            for index, copy in zip(left, reply.copies, strict=False):
                word = word_of(copy)
                if word is not None and reply.holders[copy.holders].members[0].node == self._owner:
                    self._versions[index] = word
            left = left[len(reply.copies) :]
        if len(self._versions) < len(self._frame):
            raise Refused(RejectReason.NOT_READY, "the owner cannot say now what lies there", where=self._calls.address_of(self._owner))

    # --------------------------------------------------------------------------------------------------------- bytes

    async def _work(self, node: NodeId) -> None:
        """Ask one node for whatever is next, as long as there is anything that it may have, and it answers."""
        address, shares, answers = self._calls.address_of(node), self._shares, True
        while answers and shares.may_help(node):
            patience_s = self._calls.tails.limit_s(CLIENT_GET_KEYS)
            if not shares.is_wanted_of(node, self._now(), patience_s):
                with trio.move_on_after(patience_s):
                    await self._change.wait()
                continue
            async with self._calls.turn(address):
                # Who had to wait for its turn may find less, or nothing.
                part = shares.next_of(node, self._now()) or shares.late_of(node, self._now(), patience_s)
                if part:
                    answers = await self._ask(node, part)

    async def _ask(self, node: NodeId, part: list[int]) -> bool:
        """Ask a node for these; whether it has answered."""
        began = self._now()
        try:
            await (self._ask_own(part) if node == self._owner else self._ask_holder(node, part))
        except (Unreachable, Refused, PeerFault) as problem:
            if node == self._owner:
                self._problem = problem
            return False
        finally:
            self._shares.ended(node, [index for index in part if index not in self._unsure])
            self._changed()
        self._calls.tails.note(node, len(part), self._now() - began)
        return True

    async def _ask_own(self, part: list[int]) -> None:
        left = part
        while left:
            done = left[: await self._ask_once(self._owner, left)]
            for index in filter(self._wanted.is_here, done):
                self._shares.came(index)
            left = left[len(done) :]

    async def _ask_holder(self, node: NodeId, part: list[int]) -> None:
        left = part
        while left:
            reply = await ask_copies(self._reads, self._wanted, node, left, digests_only=False, any_copy=True)
            answered = [(index, copy) for index, copy in zip(left, reply.copies, strict=False) if word_of(copy) is not None]
            forged = await self._reads.forged(self._wanted, [(index, copy.record) for index, copy in answered if copy.record is not None])
            for index, copy in answered:
                if index not in forged:
                    self._judge(index, node, copy.record)
            left = left[len(reply.copies) :]

    def _judge(self, index: int, node: NodeId, record: RecordBytes | None) -> None:
        """A holder has given this, or nothing: it is here if that is the version that counts."""
        version = self._versions.get(index)
        if version is None and not self._knows_versions:
            self._unsure[index] = node, record
            return
        self._unsure.pop(index, None)
        if version is not None and record is not None and version_of(record.header) == version:
            self._come(index, record)
        else:
            self._shares.ended(node, [index])
        if version is not None and version != (NOTHING if record is None else version_of(record.header)):
            self._reads.bad.met(self._owner, node, index)

    def _come(self, index: int, record: RecordBytes | None) -> None:
        self._wanted.take(index, record)
        self._shares.came(index)
        self._changed()

    def _now(self) -> float:
        return self._calls.world.clock.now()

    def _changed(self) -> None:
        self._change.set()
        self._change = trio.Event()
