"""What it takes to read and write one scene: its identity, the writer's key, a session, and the way to the nodes.

Space and importer build on the calls here, which speak payloads on one side and wire on the other: `put` (putting.py), `get`,
`entries`, and `read_log` and `change_log`. Sealing and opening happen in worker threads, a batch at a time.
"""

from __future__ import annotations

import math
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TypeVar

import trio

from scenefold.base.errors import DamagedData, LocalFault, PeerFault, Refused, ScenefoldError, Unreachable, UsageFault
from scenefold.base.ids import SpaceId
from scenefold.base.limits import CIPHERTEXT_BYTES_MAX, CLIENT_BATCH_BYTES, CLIENT_STATUS_S
from scenefold.base.location import Location
from scenefold.base.reasons import RejectReason
from scenefold.client.calls import Calls
from scenefold.client.copies import check_no_shadow
from scenefold.client.copy_reads import CopyReads
from scenefold.client.fetching import fetch
from scenefold.client.known_log import LOOK_S
from scenefold.client.log_reading import ReadLog
from scenefold.client.putting import put
from scenefold.client.ranging import entries
from scenefold.client.requests import Again, request_in
from scenefold.client.scene_log import LogAccess
from scenefold.client.sealing import Opened, SceneIdentity, are_sound, key_withheld, open_all, unlisted_all
from scenefold.client.setbacks import Setbacks
from scenefold.client.shares import UsualBytes
from scenefold.client.split import frames
from scenefold.client.tombstones import Lengths, tombstone
from scenefold.client.verifying import Key, NewerThanKnown
from scenefold.client.versions import Sequencer
from scenefold.client.wishes import Placed, Wish
from scenefold.crypto import EXPECTS_NOTHING, SigningKey
from scenefold.scene.log import SceneLog
from scenefold.wire import DAMAGED_RECORD, LogEntry, RecordBytes

Result = TypeVar("Result")

MISSED_S = 1.0
"""Whatever holders of copies show, a newer header that nobody has is looked for so often."""


@dataclass(eq=False)
class SceneAccess:
    """One scene as one client sees it. `writer`: the key that we sign with, if the scene's header lists it; None: nothing is written."""

    calls: Calls
    name: str
    identity: SceneIdentity
    writer: SigningKey | None
    session: int = 0
    sequencer: Sequencer = field(default_factory=Sequencer)
    lengths: Lengths = field(default_factory=Lengths)
    setbacks: Setbacks = field(default_factory=Setbacks)
    usual: UsualBytes = field(default_factory=partial(UsualBytes, CIPHERTEXT_BYTES_MAX))
    log: LogAccess | None = None
    """None: nothing is known of the scene's log, and records are written at the position of `identity`."""

    def __post_init__(self) -> None:
        # Whoever makes one has just been shown the header of `identity`.
        self._looked_at = self.calls.world.clock.now()
        self._looking = trio.Lock()
        self._look_failed: ScenefoldError | None = None
        """How the last look ended, if it failed."""
        self._missed_at = -math.inf
        """When a newer header that a record spoke of was last looked for in vain."""

    async def put(self, wishes: Sequence[Wish], *, fresh: bool = False) -> list[Placed]:
        """Seal, send, and wait until every record is durable or refused for its version.

        A wish that may replace what is there is given a higher version and sent again if a newer one was there; a
        place that is wished empty may hold a deleted record. Refused for any other reason than a stale version;
        Unreachable if an owner stays away, or if an answer was lost, or was nonsense, and nobody can tell any more what
        became of the record. PeerFault or DamagedData only if what lies there already could not be read.
        `fresh`: all of them want empty places, and the caller looks itself at what lies in taken ones.
        """
        return await put(self, wishes, fresh=fresh)

    async def put_one(self, wish: Wish) -> Placed:
        """`put` for one record; Refused with STALE_VERSION, in words, if what is there is not what was expected."""
        (placed,) = await self.put([wish])
        if placed.reason == RejectReason.STALE_VERSION:
            what = "there is a record already" if wish.expect == EXPECTS_NOTHING else "another version is there"
            raise Refused(RejectReason.STALE_VERSION, what, where=self.where(wish), remedy="read it, then decide")
        return placed

    def tombstone(self, key: Key) -> bytes:
        """A new payload that says that this record is deleted, as long as what it replaces, if that is known."""
        token = self.calls.world.entropy.token
        return tombstone(self.lengths.of_deletion(key, token), token)

    async def refresh(self, position: int = 0) -> None:
        """Take the newest public header, with the keys that it holds for us: what is written from now on is written under its position.

        `position`: one that it is known to have reached, by the word of a record.
        """
        await self._look(max(position, self.identity.position + 1))

    async def look(self) -> None:
        """Have several nodes asked for the header in the last LOOK_S, as they are for the cluster's log: so long may what is written be under a former key.

        Who only reads need not look: a record names its epoch, and is not judged by an older header than that. A look that fails does
        so for all who wait for it; it takes long enough once.
        """
        if self._is_recent():
            return
        failed_before = self._look_failed
        async with self._looking:
            if self._is_recent():
                return
            if self._look_failed is not None and self._look_failed is not failed_before:
                raise self._look_failed
            try:
                # What they have will do. A node that must ask others first would hold up the write.
                await self._look()
            except ScenefoldError as problem:
                self._look_failed = problem
                raise

    def _is_recent(self) -> bool:
        return self.log is None or self.calls.world.clock.now() - self._looked_at <= LOOK_S

    async def _look(self, have: int = 0) -> None:
        if self.log is None:
            return
        began = self.calls.world.clock.now()
        header = await self.log.header(have)
        if header is None:
            # Of a scene that this log was never shown: nobody was asked who could know.
            return
        self._looked_at = began
        if header.position > self.identity.position:
            self.identity = self.identity.with_header(header, self.log.keys.epochs)

    async def _caught_up(self, unknown: NewerThanKnown) -> bool:
        """Whether more of the scene is known now than when a record was not understood. Keys of former epochs stand in the log."""
        before = self.identity
        newest = before.keys.newest_epoch if before.key_epoch is None else before.key_epoch
        if self.log is not None and unknown.key_epoch is not None and unknown.key_epoch < newest:
            await self.read_log()
        else:
            await self.refresh(unknown.epoch)
        return self.identity != before

    async def understood(self, function: Callable[..., Result], *arguments: object) -> Result:
        """What a function makes of records by all that can be known of the scene. Refused (17) if their key is not given to us."""
        while True:
            known = self.identity
            try:
                return await self.in_crypto_lane(function, known, *arguments)
            except NewerThanKnown as unknown:
                if known == self.identity and not await self._caught_up(unknown):
                    if unknown.key_epoch is not None:
                        raise key_withheld(unknown.where) from unknown
                    raise

    async def read_log(self) -> ReadLog:
        """The newest log. Payloads that are written from now on hold coordinates as it says."""
        return self._known(await self.log_or_fault().newest())

    async def change_log(self, entry_of: Callable[[SceneLog], LogEntry], *, again: Again = None, forced: bool = False) -> ReadLog:
        """Bring an entry into the log; see `LogAccess.propose`. UsageFault for a request that does not say where it was offered."""
        request = request_in(again)
        if request is not None and not request.offered_at:
            what = "where the request was offered is not said, and what was offered there may still come"
            remedy = "give the request as the error names it, with the position; `Change()` for one that was never offered"
            raise UsageFault(what, where=f"request {request}", remedy=remedy)
        return self._known(await self.log_or_fault().propose(entry_of, again=again, forced=forced))

    def _known(self, log: ReadLog) -> ReadLog:
        keys = self.log_or_fault().keys.epochs
        if log.header.position >= self.identity.position:
            self.identity = replace(self.identity.with_header(log.header, keys), content_position=log.header.position)
        return log

    def log_or_fault(self) -> LogAccess:
        """The scene's log; LocalFault if it is not known here."""
        if self.log is None:
            raise LocalFault("the log of this scene is not known here", where=f"scene {self.name}")
        return self.log

    async def check(self, wishes: Sequence[Wish]) -> None:
        """An author writes nothing that is no output while the scene is being rendered (consensus.md §7), nor of the wrong kind."""
        await self.look()
        for wish in wishes:
            self.identity.check_kind(wish.space, wish.object)
        if self._is_frozen(wishes) or not self._may_write():
            await self.refresh()
        self.check_writer()
        self.identity.check_mode((wish.space for wish in wishes), self.name)

    def _may_write(self) -> bool:
        return self.writer is not None and self.identity.may_write(self.writer.key_id)

    def check_writer(self) -> None:
        """LocalFault, or Refused, if we may not write to the scene, by what is known of it here."""
        if self._may_write():
            return
        where = f"scene {self.name}"
        if self.writer is not None and self.writer.key_id in self.identity.writers:
            remedy = "ask an owner of the scene for access: `scenectl scene grant`"
            raise Refused(RejectReason.KEY_REVOKED, "your access to this scene was revoked", where=where, remedy=remedy)
        remedy = "ask an owner of the scene for the role of a writer: `scenectl scene grant`"
        raise LocalFault("this scene is open for reading only", where=where, remedy=remedy)

    def _is_frozen(self, wishes: Sequence[Wish]) -> bool:
        return self.identity.is_frozen(wish.space for wish in wishes)

    async def get(self, keys: Sequence[Key], *, stale_ok: bool = False) -> list[Opened | None]:
        """Fetch, verify and decrypt; None where nothing is. DamagedData if a record does not verify, Refused (16) if one
        has rotted on its owner's disk.

        A deleted record is there, and says so (`Opened.deleted`). `stale_ok`: take the answer of a node that may
        have been replaced without knowing; else it is asked again for a while, then Refused.
        """
        asked_at = self.setbacks.moment()
        records = await self.fetch(keys, stale_ok=stale_ok)
        for key, record in zip(keys, records, strict=True):
            if record == DAMAGED_RECORD:
                where = f"scene {self.identity.scene:08x}, space {key[0]}, {key[1].hex()}"
                remedy = "write it anew, or restore it from a copy"
                raise Refused(RejectReason.NOT_READY, "the record is damaged at its owner", where=where, remedy=remedy)
        sizes = [0 if record is None else len(record.ciphertext) for record in records]
        opened: list[Opened | None] = []
        for batch in frames(range(len(keys)), sizes, CLIENT_BATCH_BYTES):
            part = [keys[index] for index in batch], [records[index] for index in batch]
            opened += await self.understood(open_all, *part)
        for seq in sorted({found.seq for found in opened if found is not None}):
            self.sequencer.saw(seq, self.calls.world.clock.wall())
        for key, one in zip(keys, opened, strict=True):
            if one is not None:
                self.lengths.saw(key, one.payload)
        if stale_ok:
            for key, one in zip(keys, opened, strict=True):
                self.setbacks.showed(key, one)
        elif behind := self.setbacks.read(keys, opened, asked_at):
            self.setbacks.tell(self.calls.world.clock.now(), f"scene {self.name}", behind)
        return opened

    async def fetch(self, keys: Sequence[Key], *, stale_ok: bool = False) -> list[RecordBytes | None]:
        """The records as they lie there, unverified; see `fetching.fetch`."""
        for space in {key[0] for key in keys}:
            check_no_shadow(self.identity.layouts, space, "read")
        identity = self.identity
        # In render mode: owners alone take the header of whoever reads before they answer, and no edits from then on.
        is_alone = identity.read_floor > 0
        copies = None if is_alone else CopyReads(self.calls, identity.scene, identity.layouts, self._are_sound, self.usual)
        floor = identity.read_floor
        return await fetch(self.calls, identity.scene, identity.position, keys, stale_ok=stale_ok, copies=copies, floor=floor)

    async def _are_sound(self, keys: Sequence[Key], records: Sequence[RecordBytes]) -> list[bool]:
        """Whether each is what a writer put there. What may be newer than what is known of the scene is looked at again once more is known; if
        that does not help, it is not: anybody could make up a writer that nobody knows, and would be believed to have the newest of all."""
        known = self.identity
        verdicts = await self.in_crypto_lane(are_sound, known, keys, records)
        missing = [verdict.epoch for verdict in verdicts if isinstance(verdict, NewerThanKnown)]
        if missing:
            if known == self.identity:
                await self._learn_more(max(missing))
            if known != self.identity:
                verdicts = await self.in_crypto_lane(are_sound, self.identity, keys, records)
        return [verdict is True for verdict in verdicts]

    async def _learn_more(self, position: int) -> None:
        """Take a newer header if somebody has one; not again soon if nobody has, nor for long: who names that position may lie."""
        known, now = self.identity, self.calls.world.clock.now()
        if now - self._missed_at < MISSED_S:
            return
        with suppress(Unreachable, Refused, PeerFault, DamagedData), trio.move_on_after(CLIENT_STATUS_S):
            await self.refresh(position)
        if self.identity == known:
            self._missed_at = now

    async def unlisted(self, keys: Sequence[Key], *, stale_ok: bool = False) -> list[bool]:
        """Which of these records are deleted, parts of others, or not there. What is damaged, or none of the scene's, nobody can say so of."""
        records = await self.fetch(keys, stale_ok=stale_ok)
        return await self.understood(unlisted_all, keys, records)

    async def locations(self, space: SpaceId, first: Location, last: Location, *, stale_ok: bool = False) -> AsyncIterator[Location]:
        """Locations of a space that hold records, deleted ones too, from `first` to `last`, in order; asked for as
        they are used."""
        async for location, _ in self.entries(space, first, last, stale_ok=stale_ok):
            yield location

    async def entries(
        self, space: SpaceId, first: Location, last: Location, *, stale_ok: bool = False
    ) -> AsyncIterator[tuple[Location, bytes]]:
        """Likewise with the object id of each record; b"" in a fixed space."""
        check_no_shadow(self.identity.layouts, space, "list")
        async for entry in entries(self.calls, self.identity.scene, space, first, last, stale_ok=stale_ok):
            yield entry

    async def in_crypto_lane(self, function: Callable[..., Result], *arguments: object) -> Result:
        return await self.calls.world.workers.run("crypto", function, *arguments)

    def where(self, wish: Wish) -> str:
        """What a wish is about, for an error."""
        return f"scene {self.name}, space {wish.space}, {wish.location.hex()}"
