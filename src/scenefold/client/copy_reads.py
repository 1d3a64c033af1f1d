"""Reads that holders of copies answer where the owner is slow or away (specs/20-copies.md, Reads).

The owner is asked first. If it says nothing for longer than nineteen of twenty answers took lately, or did not answer the last
time, those who hold copies are asked as well, as placement gives them; whatever comes first counts.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from functools import partial

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, SceneId, SpaceId
from scenefold.base.limits import CLIENT_STATUS_S
from scenefold.base.location import Location
from scenefold.client.calls import Calls
from scenefold.client.copy_words import CopyWords, enough
from scenefold.client.verifying import Key
from scenefold.scene.log import Layouts
from scenefold.wire import CopiesFound, CopyState, GetCopies, RecordBytes, RecordKey
from scenefold.world import background_tasks, first_of

AskOwner = Callable[[NodeId, list[int]], Awaitable[None]]
Groups = dict[tuple[NodeId, ...], list[int]]
"""By who holds copies: which of the keys that are asked for."""
Take = Callable[[int, RecordBytes | None], None]


@dataclass(frozen=True, slots=True)
class CopyReads:
    """Who may be asked in an owner's stead for records of one scene, and how."""

    calls: Calls
    scene: SceneId
    layouts: Layouts

    def holders(self, space: SpaceId, home: Location) -> tuple[NodeId, ...]:
        """Who holds copies of a place, as far as the client knows the line; nobody if the space has no shadows."""
        offsets = self.layouts.offsets.get(space, ())
        return self.calls.table.holders_of(offsets, home, self.layouts.needed[space]) if offsets else ()

    async def beside(
        self,
        ask_owner: AskOwner,
        keys: Sequence[Key],
        homes: Sequence[Location],
        position: int,
        take: Take,
        owner: NodeId,
        frame: list[int],
    ) -> None:
        """Ask the owner for some of the keys, by their numbers, and, if it is slow, the holders; `take` is told what they say that counts.

        Returns once the owner has answered or all are known otherwise. What the owner raises is raised if the holders do not know all.
        """
        groups = self._groups(keys, homes, frame)
        if not groups:
            await ask_owner(owner, frame)
            return
        asked = _Beside(self, keys, homes, position, take)
        await asked.race(partial(ask_owner, owner, frame), owner, groups, is_whole=sum(map(len, groups.values())) == len(frame))

    async def instead(self, keys: Sequence[Key], homes: Sequence[Location], position: int, take: Take, frame: list[int]) -> None:
        """Ask the holders alone: the owner has said that it has lost these."""
        await _Beside(self, keys, homes, position, take).ask_holders(self._groups(keys, homes, frame))

    def _groups(self, keys: Sequence[Key], homes: Sequence[Location], frame: Sequence[int]) -> Groups:
        """Those of the keys that anybody holds copies of, by who does."""
        groups: Groups = {}
        for index in frame:
            if holders := self.holders(keys[index][0], homes[index]):
                groups.setdefault(holders, []).append(index)
        return groups


class _Beside:
    """One such question."""

    def __init__(self, reads: CopyReads, keys: Sequence[Key], homes: Sequence[Location], position: int, take: Take) -> None:
        self._reads = reads
        self._keys, self._homes, self._position, self._take = keys, homes, position, take
        self._words: dict[int, CopyWords] = {}

    async def race(self, ask_owner: Callable[[], Awaitable[None]], owner: NodeId, groups: Groups, *, is_whole: bool) -> None:
        """`is_whole`: these groups are all that the owner is asked for."""
        calls = self._reads.calls
        began = calls.world.clock.now()
        problem: Unreachable | Refused | PeerFault | None = None
        owner_ended, holders_ended = trio.Event(), trio.Event()

        async def by_owner() -> None:
            nonlocal problem
            try:
                await ask_owner()
                calls.tail.note(calls.world.clock.now() - began)
            except (Unreachable, Refused, PeerFault) as error:
                problem = error
            owner_ended.set()

        async def by_holders() -> None:
            await self.ask_holders(groups)
            holders_ended.set()

        def is_known() -> bool:
            by_owner = owner_ended.is_set() and problem is None
            return by_owner or (holders_ended.is_set() and is_whole and all(words.is_here() for words in self._words.values()))

        async with background_tasks() as nursery:
            nursery.start_soon(by_owner)
            # Who did not answer the last time is hardly worth waiting for.
            with trio.move_on_after(0.0 if calls.is_silent(owner) else calls.tail.limit_s):
                await owner_ended.wait()
            if not is_known():
                nursery.start_soon(by_holders)
                await first_of(owner_ended.wait, holders_ended.wait)
            if not is_known():
                await owner_ended.wait()
            if not is_known():
                await holders_ended.wait()
        if problem is not None and not is_known():
            raise problem

    async def ask_holders(self, groups: Groups) -> None:
        """Hear all of them, and take what counts."""
        async with trio.open_nursery() as nursery:
            for nodes, indices in groups.items():
                nursery.start_soon(self._ask_holders, nodes, indices)

    async def _ask_holders(self, nodes: tuple[NodeId, ...], indices: list[int]) -> None:
        """Ask all holders of some records at once: the first of them for the records, the others which versions they have."""
        layouts, table = self._reads.layouts, self._reads.calls.table
        for index in indices:
            space = self._keys[index][0]
            least = enough(1 + len(layouts.offsets[space]), layouts.needed[space])
            owners = frozenset(owner.node_id for owner in table.candidates(self._homes[index]))
            self._words[index] = CopyWords(least, owners)
        async with trio.open_nursery() as nursery:
            for place, node in enumerate(nodes):
                nursery.start_soon(partial(self._ask, node, indices, digests_only=place > 0))
        # Of some the first had nothing to say, or something else than the others.
        lacking = [index for index in indices if self._words[index].version is not None and not self._words[index].is_here()]
        for node in nodes[1:]:
            lacking = [index for index in lacking if not self._words[index].is_here()]
            if lacking:
                await self._ask(node, lacking, digests_only=False)
        for index in indices:
            if self._words[index].is_here():
                self._take(index, self._words[index].record)

    async def _ask(self, node: NodeId, indices: list[int], *, digests_only: bool) -> None:
        """Hear what one holder says of these. Its silence is nobody's trouble."""
        calls, left = self._reads.calls, list(indices)
        address = calls.address_of(node)
        while left:
            keys = tuple(RecordKey(*self._keys[index]) for index in left)
            packet = GetCopies(self._reads.scene, self._position, keys, digests_only, False)
            try:
                async with calls.turn(address):
                    reply = await calls.ask(address, packet, CopiesFound, timeout_s=CLIENT_STATUS_S)
            except (Unreachable, Refused, PeerFault):
                return
            if not 1 <= len(reply.copies) <= len(left):
                return
            for index, copy in zip(left, reply.copies, strict=False):
                if copy.state is not CopyState.NO_CUSTODY:
                    self._words[index].hear(node, reply.holders[copy.holders], copy)
            left = left[len(reply.copies) :]
