"""Holders of copies are asked in an owner's stead, and what enough of them say counts (specs/20-copies.md, Reads)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId
from scenefold.base.limits import CLIENT_STATUS_S
from scenefold.client.copy_words import CopyWords, enough
from scenefold.wire import CopiesFound, CopyState, GetCopies, RecordKey

if TYPE_CHECKING:
    from scenefold.client.copy_reads import CopyReads, Wanted

Groups = dict[tuple[NodeId, ...], list[int]]
"""By who holds copies: which of the keys that are asked for."""


class AskedHolders:
    """What they say of records of one call."""

    def __init__(self, reads: CopyReads, wanted: Wanted) -> None:
        self._reads = reads
        self._wanted = wanted
        self._words: dict[int, CopyWords] = {}

    def have(self, indices: Sequence[int]) -> bool:
        """Whether it is known of all of these what counts, and it is here."""
        return all(index in self._words and self._words[index].is_here() for index in indices)

    def version(self, index: int) -> bytes | None:
        """The version that counts; None as long as none does."""
        return self._words[index].version if index in self._words else None

    def otherwise(self, index: int, version: bytes) -> set[NodeId]:
        """Who has said of a record that it is not of this version."""
        return self._words[index].otherwise(version) if index in self._words else set()

    async def ask(self, groups: Groups, *, versions_only: bool = False) -> None:
        """Hear all of them, and take what counts. `versions_only`: what lies there is of no interest, but which version."""
        async with trio.open_nursery() as nursery:
            for nodes, indices in groups.items():
                nursery.start_soon(partial(self._ask_group, nodes, indices, versions_only=versions_only))

    async def _ask_group(self, nodes: tuple[NodeId, ...], indices: list[int], *, versions_only: bool) -> None:
        """Ask all holders of some records at once: the best of them for the records, the others which versions they have."""
        calls, layouts = self._reads.calls, self._reads.layouts
        for index in indices:
            space = self._wanted.keys[index][0]
            least = enough(1 + len(layouts.offsets[space]), layouts.needed[space])
            self._words[index] = CopyWords(least, frozenset(self._reads.owners(self._wanted.homes[index])))
        ordered = sorted(nodes, key=lambda node: (calls.is_silent(node), calls.tails.is_behind(node)))
        async with trio.open_nursery() as nursery:

            async def ask(node: NodeId, *, digests_only: bool) -> None:
                await self._ask(node, indices, digests_only=digests_only)
                if self.have(indices):
                    # Whoever has not answered yet changes nothing any more.
                    nursery.cancel_scope.cancel()

            for place, node in enumerate(ordered):
                nursery.start_soon(partial(ask, node, digests_only=versions_only or place > 0))
        if versions_only:
            return
        # Of some the first had nothing to say, or something else than the others.
        for node in ordered[1:]:
            lacking = [index for index in indices if self.version(index) is not None and not self._words[index].is_here()]
            if lacking:
                await self._ask(node, lacking, digests_only=False)
        for index in indices:
            if self._words[index].is_here():
                self._wanted.take(index, self._words[index].record)

    async def _ask(self, node: NodeId, indices: Sequence[int], *, digests_only: bool) -> None:
        """Hear what one holder says of these. Its silence is nobody's trouble."""
        left = list(indices)
        while left:
            try:
                async with self._reads.calls.turn(self._reads.calls.address_of(node), 1 if digests_only else len(left)):
                    reply = await ask_copies(self._reads, self._wanted, node, left, digests_only=digests_only)
            except (Unreachable, Refused, PeerFault):
                return
            told = list(zip(left, reply.copies, strict=False))
            forged = await self._reads.forged(self._wanted, [(index, copy.record) for index, copy in told if copy.record is not None])
            for index, copy in told:
                if copy.state is not CopyState.NO_CUSTODY:
                    self._words[index].hear(node, reply.holders[copy.holders], copy, is_forged=index in forged)
            left = left[len(reply.copies) :]


async def ask_copies(
    reads: CopyReads, wanted: Wanted, node: NodeId, indices: Sequence[int], *, digests_only: bool, any_copy: bool = False
) -> CopiesFound:
    """What a node says of the first of these, at least of one. Errors as of `Calls.ask`."""
    address = reads.calls.address_of(node)
    keys = tuple(RecordKey(*wanted.keys[index]) for index in indices)
    packet = GetCopies(reads.scene, wanted.position, keys, digests_only, any_copy)
    reply = await reads.calls.ask(address, packet, CopiesFound, timeout_s=CLIENT_STATUS_S)
    if not 1 <= len(reply.copies) <= len(indices):
        raise PeerFault(f"{len(reply.copies)} copies for {len(indices)} keys", where=address)
    return reply
