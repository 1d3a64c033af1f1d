"""An owner tells holders what they hold for it, until each has confirmed (specs/20-copies.md, Custody, Configurations).

Everything that is said is durable here before, and everything that is confirmed is durable here before it counts.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import trio

from scenefold.base.cover import without
from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import address_of
from scenefold.base.location import Arc
from scenefold.base.reasons import RejectReason
from scenefold.peer.copies.configurations import Configurations, Word
from scenefold.peer.copies.copies import Copies
from scenefold.peer.copies.numbers import is_believed
from scenefold.peer.copies.telling import told_entry
from scenefold.peer.line.holding import Holding
from scenefold.peer.line.parts import Parts
from scenefold.peer.line.pauses import Pauses
from scenefold.peer.replication.telling_words import members_of, untold, words_for
from scenefold.wire import CustodySet, Member, SetCustody
from scenefold.world import Priority, first_of

ASK_S_MAX = 5.0

_log = logging.getLogger("scenefold.peer.replication")


class Telling:
    """Used from the Trio thread only."""

    def __init__(self, parts: Parts) -> None:
        self._parts = parts
        self._telling: set[Member] = set()

    async def run(self) -> None:
        """Tell everybody, each in its own time, until cancelled."""
        async with trio.open_nursery() as nursery:
            nursery.start_soon(self._count_out)
            while True:
                seen = self._parts.keeper.copies
                for holder in untold(seen.configurations):
                    if holder not in self._telling and not self._parts.keeper.is_removed(holder):
                        self._telling.add(holder)
                        nursery.start_soon(self._tell, holder)
                await self._parts.keeper.copies_changed_after(seen)

    async def _tell(self, holder: Member) -> None:
        """Until it has confirmed everything, or was removed."""
        parts = self._parts
        pauses = Pauses(parts.world)
        rises = 0
        try:
            while not parts.keeper.is_removed(holder):
                words = words_for(parts.keeper.copies.configurations, holder, self._places())
                if not words:
                    return
                try:
                    rises = 0 if await self._say(words[0]) else rises + 1
                    if rises > 1:
                        # It has met ever more, or lies: each time is a change on this disk.
                        await pauses.wait()
                    else:
                        pauses.reset()
                except (Refused, Unreachable, PeerFault) as problem:
                    _log.debug("%s has not confirmed what it holds: %s", address_of(holder.node), problem)
                    await pauses.wait()
        finally:
            self._telling.discard(holder)

    def _places(self) -> list[Arc]:
        """What of the arc may be spoken of."""
        arc = self._parts.keeper.holding.arc
        rest = [] if arc is None else [arc]
        for gap in self._parts.keeper.copies.unrecovered:
            rest = [left for part in rest for left in without(part, gap)]
        return rest

    async def _say(self, word: Word) -> bool:
        """Whether it has confirmed; else it is told again under a higher number. Refused if it does not take it now."""
        parts, holder, scope = self._parts, word.holder, word.scope
        # What is whole is whole of what has these layouts now. Whoever answers by it must not believe that others have them.
        await parts.knowing.ensure(holder)
        entries = tuple(map(told_entry, word.entries))
        request = SetCustody(parts.own.member, holder, word.number, scope.first, scope.last, entries)
        reply = await parts.peers.ask(holder.node, Priority.LOW, request, CustodySet, ASK_S_MAX)
        if not reply.reason:
            await self._change(lambda found: found.confirm(word))
            parts.events["custody told"] += 1
            return True
        if reply.reason == RejectReason.POSITION_BEHIND:
            await self._rise(word, reply.number)
            return False
        if reply.reason == RejectReason.WRONG_INCARNATION:
            # The log knows about it, or will.
            await parts.cluster_log.pull_from(holder.node)
        raise Refused(RejectReason(reply.reason), reply.text or "the holder refused")

    async def _rise(self, word: Word, highest: int) -> None:
        if not is_believed(highest, self._parts.cluster_log.registry.position):
            await self._parts.cluster_log.pull_from(word.holder.node)
        if not is_believed(highest, self._parts.cluster_log.registry.position):
            raise PeerFault("no honest owner has come to such a number of configurations", where=address_of(word.holder.node))
        await self._change(lambda found: found.met(word, highest))
        self._parts.events["numbers met"] += 1

    async def _count_out(self) -> None:
        """Whoever the log has removed answers for nothing any more once its leases are over."""
        parts = self._parts
        pauses = Pauses(parts.world)
        while True:
            seen, registry = parts.keeper.copies, parts.cluster_log.registry
            over: list[Member] = []
            wait_s = float("inf")
            for member in members_of(seen.configurations):
                removal = registry.removal(member.incarnation)
                if removal is None or seen.configurations.remove(member) is seen.configurations:
                    continue
                left_s = parts.leases_end_in_s(removal.position)
                if left_s > 0:
                    wait_s = min(wait_s, left_s)
                else:
                    over.append(member)
            try:
                for member in over:
                    await self._change(partial(Configurations.remove, member=member))
                    parts.events["holders counted out"] += 1
            except Refused as refusal:
                _log.debug("who is gone is counted out later: %s", refusal)
                await pauses.wait()
                continue
            pauses.reset()
            if not over:
                with trio.move_on_after(wait_s):
                    await first_of(
                        partial(parts.keeper.copies_changed_after, seen), partial(parts.cluster_log.changed_after, registry.position)
                    )

    async def _change(self, change: Callable[[Configurations], Configurations]) -> None:
        def changed(copies: Copies, _holding: Holding) -> Copies:
            after = change(copies.configurations)
            return copies if after is copies.configurations else replace(copies, configurations=after)

        await self._parts.keeper.change_copies(changed)
