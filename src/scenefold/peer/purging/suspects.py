"""What this node has brought along from a former life, and nobody may bring home by himself (specs/22-purge.md, Who was away).

Before this life takes part in anything, what may be older than something purged is set aside. Of that, what its owner turns out to have,
or something newer, goes in the course of time. The rest is kept, and waits for somebody who holds the scene's key.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from itertools import islice
from typing import Any

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, SceneId, address_of
from scenefold.peer.copies.versions import rank_of, told_version
from scenefold.peer.line.parts import Parts
from scenefold.store import Held, Spot
from scenefold.wire import HeldRecord, OfferStrays, StraysJudged
from scenefold.world import Priority

OFFER_RECORDS = 256
ASK_S_MAX = 30.0
PAUSE_S_MIN = 5.0
PAUSE_S_MAX = 300.0
SCENES_TOLD_MAX = 16
"""Of a report."""
UNKNOWN_SCENE = 1 << 64
"""Above each epoch: of a scene that nobody knows nobody can tell what was purged."""

_log = logging.getLogger("scenefold.peer.purging")


class Suspects:
    """Used from the Trio thread only."""

    def __init__(self, parts: Parts) -> None:
        self._parts = parts
        self._counts: dict[SceneId, int] = {}

    async def set_aside(self) -> None:
        """Look through what a former life has left, by the headers as they are known now. Before this life has anything by right.

        Refused if the disk is full. It may be begun again at any time.
        """
        store = self._parts.store
        if await store.has_former_life():
            moved = 0
            for scene in await store.scenes_kept():
                purged = await self._purged(scene)
                if purged:
                    moved += await store.set_aside(scene, purged)
            await store.end_former_life()
            if moved:
                _log.warning("%d records of before this node was away are set aside: deletions were purged meanwhile", moved)
        self._counts = await store.suspect_counts()

    async def _purged(self, scene: SceneId) -> int:
        """Below it an epoch may be that of something purged."""
        try:
            return (await self._parts.scenes.known(scene, ask=False)).public.purged
        except Refused:
            return UNKNOWN_SCENE

    async def run(self) -> None:
        """Let go what others have, ever more seldom, until nothing is left, or cancelled."""
        parts = self._parts
        await parts.arrival.done()
        pause_s = PAUSE_S_MIN
        while self._counts:
            gone = await self._look()
            self._counts = await parts.store.suspect_counts()
            pause_s = PAUSE_S_MIN if gone else min(PAUSE_S_MAX, 2 * pause_s)
            with trio.move_on_after(pause_s):
                await parts.something_new(parts.keeper.holding.revision, parts.cluster_log.registry.position)
                # Who owns what by now has to be told first.
                await parts.world.clock.sleep(PAUSE_S_MIN)

    async def _look(self) -> int:
        """One walk over all suspects; how many went."""
        gone, cursor = 0, b""
        silent: set[NodeId] = set()
        while True:
            page = await self._parts.store.suspects(None, cursor, OFFER_RECORDS)
            gone += await self._let_go(page.records, silent)
            if page.cursor is None:
                return gone
            cursor = page.cursor

    async def _let_go(self, records: Sequence[Held], silent: set[NodeId]) -> int:
        present = await self._parts.store.record_headers([held.spot for held in records])
        settled = [
            held
            for held, header in zip(records, present, strict=True)
            # What lies here by right, or as a stray of this life, nobody has purged.
            if header is not None and rank_of(told_version(header)) >= rank_of(told_version(held.header))
        ]
        for owner, offered in self._by_owner([held for held in records if held not in settled]):
            if owner in silent:
                continue
            try:
                settled += await self._had_by(owner, offered)
            except (Refused, Unreachable, PeerFault) as problem:
                silent.add(owner)
                _log.debug("%s does not say what it has of the suspects: %s", address_of(owner), problem)
        if not settled:
            return 0
        try:
            gone = await self._parts.store.discard_suspects([(held.spot, told_version(held.header).digest) for held in settled])
        except Refused as refusal:
            # A full disk: they are found anew.
            _log.debug("suspects stay for now: %s", refusal)
            return 0
        self._parts.events["suspects had by others"] += gone
        return gone

    def _by_owner(self, records: Sequence[Held]) -> list[tuple[NodeId, list[Held]]]:
        owners: dict[NodeId, list[Held]] = {}
        for held in records:
            try:
                owner = self._parts.owners.owner_of(held.home)
            except Refused:
                continue
            if owner != self._parts.own.me:
                owners.setdefault(owner, []).append(held)
        return sorted(owners.items(), key=lambda owned: owned[0])

    async def _had_by(self, owner: NodeId, records: Sequence[Held]) -> list[Held]:
        request = OfferStrays(tuple(map(told, records)))
        reply = await self._parts.peers.ask(owner, Priority.LOW, request, StraysJudged, ASK_S_MAX)
        return [held for held, reason in zip(records, reply.reasons, strict=False) if reason == 0]

    def document(self) -> dict[str, Any]:
        """For the report: as of the last look."""
        most = sorted(self._counts.items(), key=lambda counted: (-counted[1], counted[0]))
        return {
            "records": sum(self._counts.values()),
            "scenes": [{"scene": f"{scene:08x}", "records": count} for scene, count in islice(most, SCENES_TOLD_MAX)],
        }

    async def discard(self, versions: Sequence[tuple[Spot, bytes]]) -> int:
        """Delete what somebody who may has asked for; how many were there."""
        gone = await self._parts.store.discard_suspects(versions)
        self._counts = await self._parts.store.suspect_counts()
        self._parts.events["suspects discarded"] += gone
        return gone


def told(held: Held) -> HeldRecord:
    """A suspect as packets name it."""
    place = held.spot.place
    return HeldRecord(place.scene, place.space, place.location, held.spot.object, told_version(held.header))
