"""One node is asked what it has of an arc, and brings what is newer than what lies here (specs/20-copies.md, Recovery).

Nothing is remembered of a page but where the next one begins: of every place the newest version is what lies on this node's disk once
everybody was heard, whoever named it. So a version that one node cannot deliver any more is fetched from the next that names it.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from contextlib import AbstractAsyncContextManager
from dataclasses import replace

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import address_of
from scenefold.base.location import Arc
from scenefold.base.reasons import RejectReason
from scenefold.peer.copies.entries import Entry
from scenefold.peer.copies.versions import rank_of, told_version
from scenefold.peer.line.parts import Parts
from scenefold.peer.line.receiving import keep_durably, verified
from scenefold.peer.records.verification import epochs_of, home_of
from scenefold.peer.replication.recovering_roll import Roll
from scenefold.peer.replication.recovering_walk import Patience, Walk, spot_of_held
from scenefold.store import Put
from scenefold.wire import FetchHeld, HandItem, HeldFetched, HeldListed, HeldRecord, ListHeld, Member, RecordEntry, SceneTurn
from scenefold.world import Priority

PAGE_RECORDS = 1024
FETCH_RECORDS = 256
FEWER = 4
"""After an answer that did not come so many times fewer records are asked for at once."""
LIST_S_MAX = 10.0
"""For a page, which a promise is made durable for."""
FETCH_S_MAX = 10.0
"""For a frame full of records."""
BRING_S_MAX = 30.0
"""For the records of one page; what did not come by then is asked for again."""

_log = logging.getLogger("scenefold.peer.replication")


class Hearing:
    """Of one node about one arc: the gap, or one place of it. Used from the Trio thread only."""

    def __init__(self, parts: Parts, roll: Roll, teller: Member, arc: Arc, turn: AbstractAsyncContextManager[object]) -> None:
        """`turn`: held while records are fetched, by one hearing at a time, since several nodes name the same ones."""
        self._parts = parts
        self._roll = roll
        self._position = roll.position
        self._teller = teller
        self._arc = arc
        self._turn = turn
        self._walk = Walk(teller, arc, roll.number)
        self._patience = Patience()
        self._at_once = FETCH_RECORDS
        """Fewer of one whose answers do not come in time: what is sound and on its way must not count as not held."""
        self._budget_s = 0.0
        """Waited, while a page was brought, until its bytes were earned."""
        self.is_silent = False
        """Whether it did not answer when it was asked last."""

    async def hear(self) -> tuple[Entry, ...]:
        """All that the node has of the arc is here, durably; what it has told of custody.

        Refused, Unreachable or PeerFault: not now. Called again, it goes on.
        """
        while not (self._walk.is_over or self._patience.is_over):
            await self._parts.world.clock.sleep(await self._next_page())
        if self._patience.is_over:
            self._parts.events["disbelieved"] += 1
            _log.warning("%s: what it names of %s cannot be, or does not come: it is heard no further", self._name, self._where)
        return self._walk.entries

    async def _next_page(self) -> float:
        """Bring what one page names; seconds until it, or the next one, is asked for."""
        try:
            page = await self._listed()
            named = self._walk.check(page)
        except PeerFault:
            self._patience.note_nonsense()
            raise
        if named:
            async with self._turn:
                wanted = await self._lacking(named)
                # What others hold up, or the budget, tries nobody's patience.
                begin, self._budget_s = trio.current_time(), 0.0
                denied = await self._bring(wanted) if wanted else set()
                took_s = trio.current_time() - begin - self._budget_s
                left = await self._lacking(wanted)
            if len(left) < len(wanted):
                self._patience.delivered()
                if left:
                    return 0.0
            elif left:
                pause_s = self._patience.failed(len(left), min(took_s, BRING_S_MAX), are_denied=denied.issuperset(map(_entry_of, left)))
                if pause_s is not None:
                    return pause_s
                self._parts.events["named, not delivered"] += len(left)
                _log.warning("%s does not deliver %d versions in %s that it names", self._name, len(left), self._where)
        self._walk.move_on(page)
        return 0.0

    async def _listed(self) -> HeldListed:
        request = ListHeld(
            self._parts.own.member,
            self._teller,
            self._position,
            self._arc.first,
            self._arc.last,
            self._walk.after,
            PAGE_RECORDS,
        )
        try:
            page = await self._parts.peers.ask(self._teller.node, Priority.LOW, request, HeldListed, LIST_S_MAX)
        except (Refused, Unreachable, PeerFault):
            self.is_silent = True
            raise
        self.is_silent = page.reason != 0
        if page.reason:
            raise Refused(RejectReason(page.reason), f"{self._name} does not say what it has of {self._where}")
        # Of the layouts that it holds copies by, this node would not know whose they are.
        await self._parts.knowing.learn(self._teller, page.turns)
        return page

    async def _lacking(self, named: Sequence[HeldRecord]) -> list[HeldRecord]:
        """Those of which nothing as new lies here."""
        if not named:
            return []
        headers = await self._parts.store.record_headers([spot_of_held(held) for held in named])
        return [
            held
            for held, header in zip(named, headers, strict=True)
            if header is None or rank_of(told_version(header)) < rank_of(held.version)
        ]

    async def _bring(self, wanted: Sequence[HeldRecord]) -> set[RecordEntry]:
        """As much as comes; what the node says that it has not. Refused if it cannot be kept here."""
        denied: set[RecordEntry] = set()
        with trio.move_on_after(BRING_S_MAX):
            named = list(map(_entry_of, wanted))
            while named:
                batch = named[: self._at_once]
                try:
                    request = FetchHeld(tuple(batch))
                    reply = await self._parts.peers.ask(self._teller.node, Priority.LOW, request, HeldFetched, FETCH_S_MAX)
                except (Refused, Unreachable, PeerFault) as problem:
                    _log.debug("%s does not deliver: %s", self._name, problem)
                    self._at_once = max(1, len(batch) // FEWER)
                    return denied
                answered = len(reply.items) + len(reply.missing)
                if not 1 <= answered <= len(batch):
                    return denied
                rotten = await self._take(reply.items)
                denied.update(batch[index] for index in reply.missing if index < len(batch))
                denied.update(rotten)
                named = named[answered:]
        return denied

    async def _take(self, items: Sequence[HandItem]) -> list[RecordEntry]:
        """Keep what is sound and lies in the arc by its home; whatever else came, was not asked for. Of what is not sound the names.

        What is left of that waits until all were heard: somebody else may have it sound, or something older.
        """
        inside = [item for item in items if home_of(item) in self._arc]
        await self._learn_scenes(inside)
        verdicts = await verified(self._parts, inside, or_husks=True)
        # An object comes to lie at its home: that is in the arc, wherever it lay.
        puts = [
            (item, replace(verdict, at=home_of(item)) if item.object else verdict)
            for item, verdict in zip(inside, verdicts, strict=True)
            if isinstance(verdict, Put)
        ]
        whole = [put for _, put in puts if not put.is_husk]
        await keep_durably(self._parts.store, whole)
        self._parts.events["fetched"] += len(whole)
        husks = [(item, put) for item, put in puts if put.is_husk]
        for _, husk in husks:
            self._roll.note_husk(husk)
        size_bytes = sum(len(item.header) + len(item.signature) + len(item.ciphertext) for item in items)
        self._parts.events["recovered bytes"] += size_bytes
        if self._arc.first == self._arc.last:
            # Somebody waits for this place.
            self._parts.budget.charge(size_bytes)
        else:
            await self._earn(size_bytes)
        return [RecordEntry(item.scene, item.space, item.location, item.object, husk.record.header.digest) for item, husk in husks]

    async def _earn(self, size_bytes: int) -> None:
        begin = trio.current_time()
        try:
            await self._parts.budget.take(size_bytes)
        finally:
            self._budget_s += trio.current_time() - begin

    async def _learn_scenes(self, items: Sequence[HandItem]) -> None:
        """Have the headers by which these can be judged. Who keeps a record knew its header; who decides the scene may have lost it since."""
        for scene, epoch in epochs_of(items).items():
            try:
                await self._parts.knowing.learn(self._teller, [SceneTurn(scene, epoch)])
            except PeerFault as problem:
                _log.debug("%s does not show by what its records can be judged: %s", self._name, problem)
            except (Refused, Unreachable) as problem:
                # It is silent, or nothing can be kept here; else the others are asked.
                _log.debug("the header of scene %08x is not had from %s: %s", scene, self._name, problem)
                return

    @property
    def _name(self) -> str:
        return address_of(self._teller.node)

    @property
    def _where(self) -> str:
        return f"{self._arc.first.hex()[:8]}..{self._arc.last.hex()[:8]}"


def _entry_of(held: HeldRecord) -> RecordEntry:
    return RecordEntry(held.scene, held.space, held.location, held.object, held.version.digest)
