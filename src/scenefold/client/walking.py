"""A walk over all records of a space, as they lie there: read a batch at a time, and opened as far as they can be.

For work whose state is what lies in the records, so that it may end at any moment, and be begun again.
"""

from __future__ import annotations

from collections.abc import AsyncGenerator, Awaitable, Callable, Sequence
from contextlib import aclosing
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import trio

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.ids import SpaceId
from scenefold.base.limits import CLIENT_GET_KEYS
from scenefold.base.location import FIRST, LAST, Location
from scenefold.base.reasons import RejectReason
from scenefold.client.access import SceneAccess
from scenefold.client.progress import ProgressCallback, ProgressState
from scenefold.client.ranging import entries
from scenefold.client.reencrypting import opened_each, opened_or_not
from scenefold.client.reencryption import Pace, is_damaged
from scenefold.client.sealing import Opened
from scenefold.client.together import worked_off
from scenefold.client.verifying import Key, NewerThanKnown
from scenefold.wire import RecordBytes

COUNTED_AT_A_TIME = 4096
COMPLAINTS_MAX = 8

Looked = list[Opened | DamagedData | None]
Work = Callable[[SpaceId, Sequence[Location], Looked], Awaitable[None]]
"""What is done with a batch: the places, and what lies there."""


@dataclass(slots=True)
class Walked:
    """How far a walk is. `complaints` are about records that stay as they are, `unreadable` counts those that cannot be read."""

    phase: str
    is_dry: bool = False
    total: int = 0
    records: int = 0
    unreadable: int = 0
    complaints: list[str] = field(default_factory=list)
    seconds: float = 0.0

    def complain(self, problem: str) -> None:
        if len(self.complaints) < COMPLAINTS_MAX and problem not in self.complaints:
            self.complaints.append(problem)

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        return {
            "dry_run": self.is_dry,
            "records": self.records,
            "unreadable": self.unreadable,
            "complaints": list(self.complaints),
            "seconds": round(self.seconds, 3),
        }


class Walk:
    """One walk over a fixed space. `bytes_per_s`: of records that are looked at."""

    def __init__(self, access: SceneAccess, space: SpaceId, walked: Walked, progress: ProgressCallback, bytes_per_s: float | None) -> None:
        self._access = access
        self._space = space
        self._walked = walked
        self._progress = progress
        self._pace = Pace(bytes_per_s)
        self._clock = access.calls.world.clock
        self._begun = 0.0

    async def over_all(self, work: Work) -> None:
        """Have everything worked off, a few batches at once."""
        begun = self._clock.now()
        async with self._listed() as listed:
            async for _ in listed:
                self._walked.total += 1
                if self._walked.total % COUNTED_AT_A_TIME == 0:
                    self._progress(ProgressState("count", self._walked.total, None, "records"))
        self._begun = self._clock.now()
        await worked_off(self._list, partial(self._work_off, work))
        self._walked.seconds = self._clock.now() - begun

    async def looked(self, places: Sequence[Location]) -> Looked:
        """What lies at these places; what cannot be understood is an error in its stead."""
        keys: list[Key] = [(self._space, place) for place in places]
        records = await self._access.fetch(keys) if keys else []
        await self._clock.sleep(self._pace.wait_s(self._clock.now(), sum(len(one.ciphertext) for one in records if one is not None)))
        whole = [None if is_damaged(record) else record for record in records]
        opened = await self._opened(keys, whole)
        return [
            DamagedData("the record is damaged at its owner", where=self.where(place)) if is_damaged(record) else one
            for place, record, one in zip(places, records, opened, strict=True)
        ]

    def where(self, place: Location) -> str:
        return f"space {self._space}, {place.hex()}"

    def _listed(self) -> aclosing[AsyncGenerator[tuple[Location, bytes], None]]:
        access = self._access
        return aclosing(entries(access.calls, access.identity.scene, self._space, FIRST, LAST, stale_ok=False))

    async def _list(self, send: trio.MemorySendChannel[list[Location]]) -> None:
        batch: list[Location] = []
        async with self._listed() as listed:
            async for location, _ in listed:
                batch.append(location)
                if len(batch) == CLIENT_GET_KEYS:
                    await send.send(batch)
                    batch = []
        if batch:
            await send.send(batch)

    async def _work_off(self, work: Work, batch: list[Location]) -> None:
        looked = await self.looked(batch)
        for one in looked:
            if isinstance(one, DamagedData):
                self._walked.unreadable += 1
                self._walked.complain(str(one))
        await work(self._space, batch, looked)
        self._walked.records += len(batch)
        done, total = self._walked.records, max(self._walked.total, self._walked.records)
        left = (self._clock.now() - self._begun) / done * (total - done)
        self._progress(ProgressState(self._walked.phase, done, total, "records", left))

    async def _opened(self, keys: Sequence[Key], records: Sequence[RecordBytes | None]) -> Looked:
        try:
            return await self._access.understood(opened_each, keys, records)
        except (NewerThanKnown, Refused) as problem:
            if isinstance(problem, Refused) and problem.reason is not RejectReason.KEY_REVOKED:
                raise
            return await self._access.in_crypto_lane(opened_or_not, self._access.identity, keys, records)
