"""Reads all records of this node again and again, at a pace that nobody notices (specs/21-verify.md, Scrub).

It reads as any reader does, so what has rotted is counted and told where all damaged records are, and whoever mends records hears of it
from the store. How far it has come survives a restart.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol

import trio

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.location import WHOLE_LINE, Arc
from scenefold.crypto import Record
from scenefold.peer.scrub.note import NOTE, decode_round, encode_round
from scenefold.peer.scrub.pace import Pace, Progress, Round
from scenefold.store import Manifest, Spot, StoreStatistics
from scenefold.store.layout import spot_of
from scenefold.world import Clock

START_S = 600.0
"""A node that has just started has better things to do."""
NOTE_S = 600.0
"""Between two notes of how far it has come: to read a little twice costs less than to write all the time."""
LOOK_S = 60.0
"""Who rests for longer looks so often whether the pace is another one by now."""
BATCH_RECORDS = 32
"""Read at a time: 2 MiB of the largest records."""

_log = logging.getLogger("scenefold.peer.scrub")


class Reads(Protocol):
    """What is asked of the store."""

    async def manifest(self, where: Arc, after: bytes | None, limit: int, /) -> Manifest: ...
    async def read(self, spots: Sequence[Spot], /) -> list[Record | DamagedData | None]: ...
    async def statistics(self) -> StoreStatistics: ...
    async def get_note(self, name: str, /) -> bytes | None: ...
    async def put_note(self, name: str, value: bytes, /) -> None: ...


class Scrub:
    """`run` it in one task. It only reads: whoever reads a rotten record has the store tell of it."""

    def __init__(self, clock: Clock, store: Reads, pace: Pace) -> None:
        self._clock = clock
        self._store = store
        self._pace = pace
        self._round = Round()
        self._noted_at = 0.0
        self._may_go = trio.Event()
        self._may_go.set()
        self.found = 0
        """Rotten records that were met since the start."""

    # ------------------------------------------------------------------------------------------------- for others

    def pause(self) -> None:
        """Read nothing more until `resume`, from the next batch on."""
        if self._may_go.is_set():
            self._may_go = trio.Event()

    def resume(self) -> None:
        self._may_go.set()

    @property
    def bytes_per_s_max(self) -> int:
        """However long a round then takes. May be set at any time."""
        return self._pace.bytes_per_s_max

    @bytes_per_s_max.setter
    def bytes_per_s_max(self, rate: int) -> None:
        self._pace = replace(self._pace, bytes_per_s_max=rate)

    @property
    def is_paused(self) -> bool:
        return not self._may_go.is_set()

    def progress(self, total_bytes: int) -> Progress:
        """How far it has come, of a store that has so many bytes."""
        return self._round.progress(self._pace, total_bytes, paused=self.is_paused)

    # ---------------------------------------------------------------------------------------------------- reading

    async def run(self) -> None:
        """Read, and rest, until cancelled."""
        await self._clock.sleep(START_S)
        await self._load()
        while True:
            await self._may_go.wait()
            pause_of = await self._step()
            begun = self._clock.now()
            while (left_s := begun + pause_of(self._pace) - self._clock.now()) > LOOK_S:
                await self._clock.sleep(LOOK_S)
            await self._clock.sleep(max(0.0, left_s))

    async def _load(self) -> None:
        """Go on where an earlier life was; and ask at once for what is known to have rotted."""
        note = await self._store.get_note(NOTE)
        try:
            self._round = Round() if note is None else decode_round(note)
        except DamagedData as damage:
            _log.warning("%s; all records are read from the first on", damage)
        self._noted_at = self._clock.now()
        told = self._round.told
        if told:
            await self._look_at([spot_of(key) for key in told])
            self._round = replace(self._round, told=())
            await self._note()

    async def _step(self) -> Callable[[Pace], float]:
        """Read a batch; how long to rest at some pace."""
        before = self._round
        page = await self._store.manifest(WHOLE_LINE, before.after, BATCH_RECORDS)
        read_bytes = sum(entry.size for entry in page.entries)
        rotten = await self._look_at([*(entry.spot for entry in page.entries), *page.damaged])
        self._round = before.read(page.cursor, len(page.entries) + len(page.damaged), read_bytes, rotten)
        is_round_over = page.cursor is None
        if is_round_over:
            _log.info("round %d of the scrub is over: %d rotten records in it", before.number, before.rotten + rotten)
        if is_round_over or self._clock.now() - self._noted_at >= NOTE_S:
            await self._note()
        total_bytes = (await self._store.statistics()).bytes
        return lambda pace: pace.pause_s(read_bytes, total_bytes, is_round_over=is_round_over)

    async def _look_at(self, spots: Sequence[Spot]) -> int:
        """Read these; how many of them have rotted."""
        found = await self._store.read(spots)
        rotten = sum(isinstance(one, DamagedData) for one in found)
        self.found += rotten
        return rotten

    async def _note(self) -> None:
        self._noted_at = self._clock.now()
        try:
            await self._store.put_note(NOTE, encode_round(self._round))
        except Refused as refusal:
            # Whoever restarts now reads some of it twice.
            _log.debug("how far the scrub has come is not noted: %s", refusal)
