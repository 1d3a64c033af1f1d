"""Holders of copies are asked in an owner's stead, and what enough of them say counts (specs/20-copies.md, Reads)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Iterable, Sequence
from functools import partial
from typing import TYPE_CHECKING

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId
from scenefold.base.limits import CLIENT_GET_KEYS, CLIENT_STATUS_S, COPIES_MAX
from scenefold.client.copy_words import CopyWords
from scenefold.client.together import together
from scenefold.wire import CopiesFound, CopyState, GetCopies, RecordKey

if TYPE_CHECKING:
    from scenefold.client.copy_reads import CopyReads, Wanted

NAMED_MAX = 2 * COPIES_MAX
"""So many others one holder can have asked: it may hold the places of one call with a few sets of others, and it may lie."""
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
        await together(partial(self._ask_group, nodes, indices, versions_only=versions_only) for nodes, indices in groups.items())

    async def _ask_group(self, nodes: tuple[NodeId, ...], indices: list[int], *, versions_only: bool) -> None:
        """Ask all holders of some records at once: the best of them for the records, the others which versions they have."""
        layouts = self._reads.layouts
        for index in indices:
            space = self._wanted.keys[index][0]
            owners = frozenset(self._reads.owners(self._wanted.homes[index]))
            self._words[index] = CopyWords(1 + len(layouts.offsets[space]), layouts.needed[space], owners)
        asked: set[NodeId] = set()
        await self._ask_all(nodes, indices, asked, versions_only=versions_only)
        if unknown := [index for index in self._undecided(indices) if self._words[index].is_silence]:
            # Nobody of these has it: a bound that has moved a little since gave it to one beside them.
            beside = dict.fromkeys(other for node in nodes for other in self._reads.calls.table.beside(node) if other not in asked)
            await self._ask_all(beside, unknown, asked, versions_only=True)
        if versions_only:
            return
        # Of some the first had nothing to say, or something else than the others.
        for node in self._best(asked):
            lacking = [index for index in indices if self.version(index) is not None and not self._words[index].is_here()]
            if lacking:
                await self._ask(node, lacking, digests_only=False)
        for index in indices:
            if self._words[index].is_here():
                self._wanted.take(index, self._words[index].record)

    async def _ask_all(self, nodes: Iterable[NodeId], indices: list[int], asked: set[NodeId], *, versions_only: bool) -> None:
        """At once, and whom these name as well, as bounds have moved and copies have not followed them yet; until enough is known.

        `versions_only` false: the best of them for the records. `asked`: who was asked already; it grows.
        """
        calls, best = self._reads.calls, self._best(nodes)
        asked.update(best)
        shown: set[tuple[NodeId, int]] = set()
        brought: Counter[NodeId] = Counter()
        async with trio.open_nursery() as nursery:

            async def ask(node: NodeId, part: list[int], *, digests_only: bool) -> None:
                await self._ask(node, part, digests_only=digests_only)
                if (not self._undecided(indices)) if versions_only else self.have(indices):
                    # Whoever has not answered yet changes nothing any more.
                    nursery.cancel_scope.cancel()
                    return
                undecided = self._undecided(part)
                for other, lacking in self._unordered(undecided, shown).items():
                    shown.update((other, index) for index in lacking)
                    nursery.start_soon(partial(ask, other, lacking, digests_only=False))
                named = {other for index in undecided for other in self._words[index].named_by(node)}
                for other in sorted(named - asked)[: NAMED_MAX - brought[node]]:
                    if calls.table.by_id(other) is not None:
                        asked.add(other)
                        brought[node] += 1
                        nursery.start_soon(partial(ask, other, undecided, digests_only=True))

            for place, node in enumerate(best):
                nursery.start_soon(partial(ask, node, indices, digests_only=versions_only or place > 0))

    def _best(self, nodes: Iterable[NodeId]) -> list[NodeId]:
        calls = self._reads.calls
        return sorted(nodes, key=lambda node: (calls.is_silent(node), calls.tails.is_behind(node)))

    def _undecided(self, indices: Sequence[int]) -> list[int]:
        return [index for index in indices if self.version(index) is None]

    def _unordered(self, indices: Sequence[int], shown: Container[tuple[NodeId, int]]) -> dict[NodeId, list[int]]:
        """Where they differ, who is to be asked for the record that it has: its header says how new that is. `shown`: who was asked for which."""
        found: dict[NodeId, list[int]] = {}
        for index in indices:
            for node in self._words[index].unordered():
                if (node, index) not in shown:
                    found.setdefault(node, []).append(index)
        return found

    async def _ask(self, node: NodeId, indices: Sequence[int], *, digests_only: bool) -> None:
        """Hear what one holder says of these. Its silence is nobody's trouble, nor is it that it says little at a time, and slowly."""
        clock, left, spent_s = self._reads.calls.world.clock, list(indices), 0.0
        while left and spent_s <= CLIENT_STATUS_S * (1 + len(indices) // CLIENT_GET_KEYS):
            try:
                async with self._reads.calls.turn(self._reads.calls.address_of(node), 1 if digests_only else len(left)):
                    began = clock.now()
                    reply = await ask_copies(self._reads, self._wanted, node, left, digests_only=digests_only)
            except (Unreachable, Refused, PeerFault):
                return
            told = list(zip(left, reply.copies, strict=False))
            forged = await self._reads.forged(self._wanted, [(index, copy.record) for index, copy in told if copy.record is not None])
            for index, copy in told:
                if copy.state is not CopyState.NO_CUSTODY:
                    self._words[index].hear(node, reply.holders[copy.holders], copy, is_forged=index in forged)
            left = left[len(reply.copies) :]
            spent_s += clock.now() - began


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
