"""What returned nodes keep apart, for who holds the scene's key to decide about (specs/22-purge.md, Who was away, Commands).

To a node such a record is either the last copy of something, or what somebody has deleted, and purged. Who can read it may know.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple

from scenefold.base.errors import DamagedData, LocalFault, PeerFault, Refused, Unreachable
from scenefold.base.ids import SpaceId
from scenefold.base.limits import CLIENT_GET_KEYS, HANDOVER_BATCH_RECORDS_MAX
from scenefold.base.location import Location
from scenefold.base.reasons import RejectReason
from scenefold.client.access import SceneAccess
from scenefold.client.progress import ProgressCallback, ProgressState, no_progress
from scenefold.client.sealing import Opened, open_all
from scenefold.client.together import together
from scenefold.client.verifying import Key
from scenefold.client.wishes import Wish
from scenefold.crypto import DISCARD_DOMAIN, EXPECTS_NOTHING, RecordHeader, signed_place, version_key, wanted_place
from scenefold.wire import (
    UNSIGNED,
    DiscardItem,
    DiscardOrder,
    DiscardSuspects,
    FetchSuspects,
    HeldRecord,
    ListSuspects,
    Member,
    RecordBytes,
    RecordEntry,
    RecordVersion,
    SuspectsDiscarded,
    SuspectsFetched,
    SuspectsListed,
)
from scenefold.wire.suspect_packets import SUSPECTS_DISCARDED_MAX

PHASE = "strays"
LISTED_MAX = 256
"""Of a list that people are shown."""
_STORED = 0


class Keeper(NamedTuple):
    """Who keeps a suspect, and which version."""

    address: str
    holder: Member
    held: HeldRecord


@dataclass(frozen=True, slots=True)
class Suspect:
    """The newest version of a record that is kept apart, as it was read. `size` None: it could not be."""

    space: SpaceId
    location: Location
    object: bytes
    kept_by: tuple[str, ...]
    epoch: int
    size: int | None
    is_deletion: bool = False
    is_replaced: bool = False
    """Something else lies at its place."""

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        return {
            "space": self.space,
            "location": self.location.hex(),
            "object": self.object.hex() or None,
            "kept_by": list(self.kept_by),
            "position": self.epoch,
            "bytes": self.size,
            "deletion": self.is_deletion,
            "replaced": self.is_replaced,
        }


@dataclass(slots=True)
class SuspectReport:
    """What nodes keep apart of a scene, and what was done with it."""

    records: int = 0
    listed: list[Suspect] = field(default_factory=list)
    """The first ones."""
    unreadable: int = 0
    restored: int = 0
    discarded: int = 0
    silent: list[str] = field(default_factory=list)
    """Nodes that did not answer: they may keep more."""

    @property
    def left(self) -> int:
        return self.records - self.discarded

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        return {
            "records": self.records,
            "strays": [suspect.document() for suspect in self.listed],
            "unreadable": self.unreadable,
            "restored": self.restored,
            "discarded": self.discarded,
            "left": self.left,
            "silent": list(self.silent),
        }


async def look_at_suspects(
    access: SceneAccess, *, restore: bool = False, discard: bool = False, progress: ProgressCallback = no_progress
) -> SuspectReport:
    """List what is kept apart of a scene; put it where nothing lies, or have it deleted, if that is wanted. A member's, a writer's to do."""
    work = _Work(access, restore=restore, discard=discard or restore, progress=progress)
    await work.run()
    return work.report


class _Work:
    def __init__(self, access: SceneAccess, *, restore: bool, discard: bool, progress: ProgressCallback) -> None:
        self.report = SuspectReport()
        self._access = access
        self._restore = restore
        self._discard = discard
        self._progress = progress
        self._done = 0

    async def run(self) -> None:
        if self._discard:
            await self._access.check(())
        # By versions alone, all of them: an older one must not be restored because its node was asked first.
        kept: dict[Key, list[Keeper]] = {}
        await self._access.calls.refresh()
        owners = self._access.calls.table.owners
        await together(partial(self._list, owner.address, kept) for owner in owners)
        self.report.records = len(kept)
        keys = sorted(kept, key=lambda key: (key[0], *key[1:]))
        for start in range(0, len(keys), CLIENT_GET_KEYS):
            part = keys[start : start + CLIENT_GET_KEYS]
            await self._look([(key, sorted(kept[key], key=_rank, reverse=True)) for key in part])
            self._done += len(part)
            self._progress(ProgressState(PHASE, self._done, len(keys), f"records, {self.report.restored} restored"))

    async def _list(self, address: str, kept: dict[Key, list[Keeper]]) -> None:
        after: bytes | None = b""
        seen: set[HeldRecord] = set()
        try:
            while after is not None:
                packet = ListSuspects(self._access.identity.scene, after, HANDOVER_BATCH_RECORDS_MAX)
                page = await self._access.calls.ask(address, packet, SuspectsListed)
                if page.next is not None and seen.issuperset(page.records):
                    raise PeerFault("a node lists what it keeps apart without an end", where=address)
                seen.update(page.records)
                for held in page.records:
                    # An object is one record, wherever a node has put it.
                    home = (held.space, wanted_place(held.object), held.object) if held.object else (held.space, held.location)
                    kept.setdefault(home, []).append(Keeper(address, page.holder, held))
                after = page.next
        except (Unreachable, PeerFault, Refused) as problem:
            if isinstance(problem, Refused) and problem.reason is RejectReason.NOT_AUTHORISED:
                raise
            self.report.silent.append(address)

    async def _look(self, found: Sequence[tuple[Key, Sequence[Keeper]]]) -> None:
        keys = [key for key, _ in found]
        records = await self._fetched([(key, keepers[0]) for key, keepers in found])
        opened = [await self._opened(key, records.get(key)) for key in keys]
        present = await self._access.fetch(keys)
        replaced = [_is_newer(record, keepers[0].held.version) for record, (_, keepers) in zip(present, found, strict=True)]
        for (key, keepers), one, is_replaced in zip(found, opened, replaced, strict=True):
            self._tell(key, keepers, one, is_replaced=is_replaced)
        if not self._discard:
            return
        done = [
            keepers
            for (key, keepers), one, is_there, is_replaced in zip(found, opened, present, replaced, strict=True)
            if not self._restore or is_replaced or (is_there is None and await self._put(key, one))
        ]
        await self._discarded([keeper for keepers in done for keeper in keepers])
        self.report.discarded += len(done)

    def _tell(self, key: Key, keepers: Sequence[Keeper], opened: Opened | None, *, is_replaced: bool) -> None:
        self.report.unreadable += opened is None
        if len(self.report.listed) == LISTED_MAX:
            return
        held, size = keepers[0].held, None if opened is None else len(opened.payload)
        addresses = tuple(sorted({keeper.address for keeper in keepers}))
        is_deletion = opened is not None and opened.deleted
        self.report.listed.append(Suspect(key[0], key[1], held.object, addresses, held.version.epoch, size, is_deletion, is_replaced))

    async def _fetched(self, wanted: Sequence[tuple[Key, Keeper]]) -> dict[Key, RecordBytes]:
        """What their keepers show of them."""
        records: dict[Key, RecordBytes] = {}
        for address in sorted({keeper.address for _, keeper in wanted}):
            here = [(key, keeper.held) for key, keeper in wanted if keeper.address == address]
            keys = {(held.space, held.location, held.object): key for key, held in here}
            entries = [RecordEntry(held.scene, held.space, held.location, held.object, held.version.digest) for _, held in here]
            try:
                while entries:
                    reply = await self._access.calls.ask(address, FetchSuspects(tuple(entries)), SuspectsFetched)
                    answered = len(reply.items) + len(reply.missing)
                    if not 1 <= answered <= len(entries):
                        raise PeerFault(f"{answered} answers for {len(entries)} records", where=address)
                    for item in reply.items:
                        key = keys.get((item.space, item.location, item.object))
                        if key is not None:
                            records[key] = RecordBytes(item.signature, item.header, item.ciphertext)
                    entries = entries[answered:]
            except (Unreachable, PeerFault):
                # What it does not show cannot be read, and is told so.
                continue
        return records

    async def _opened(self, key: Key, record: RecordBytes | None) -> Opened | None:
        """The record, if a writer of the scene has put it there once."""
        try:
            (opened,) = await self._access.understood(open_all, [key], [record])
        except DamagedData:
            return None
        return opened

    async def _put(self, key: Key, opened: Opened | None) -> bool:
        """Whether there is nothing left to restore: it lies there again, or says itself that it is deleted, or somebody has written there."""
        if opened is None:
            return False
        if opened.deleted:
            return True
        place = signed_place(key[2]) if len(key) == 3 else key[1]
        wish = Wish(key[0], place, opened.payload, EXPECTS_NOTHING, opened.content_position, key[2] if len(key) == 3 else b"")
        (placed,) = await self._access.put([wish], fresh=True)
        self.report.restored += placed.reason == _STORED
        return True

    async def _discarded(self, keepers: Iterable[Keeper]) -> None:
        by_holder: dict[tuple[str, Member], list[HeldRecord]] = {}
        for keeper in keepers:
            by_holder.setdefault((keeper.address, keeper.holder), []).append(keeper.held)
        for (address, holder), records in by_holder.items():
            for start in range(0, len(records), SUSPECTS_DISCARDED_MAX):
                order = await self._access.in_crypto_lane(self._order, holder, records[start : start + SUSPECTS_DISCARDED_MAX])
                await self._access.calls.ask(address, DiscardSuspects(order), SuspectsDiscarded)

    def _order(self, holder: Member, records: Sequence[HeldRecord]) -> DiscardOrder:
        """Signed. Runs in the crypto lane."""
        writer, identity = self._access.writer, self._access.identity
        if writer is None:
            raise LocalFault("this scene is open for reading only", where=f"scene {self._access.name}")
        items = tuple(DiscardItem(held.space, held.location, held.object, held.version.digest) for held in records)
        order = DiscardOrder(identity.scene, identity.position, writer.key_id, holder, items, UNSIGNED)
        return replace(order, signature=writer.sign(DISCARD_DOMAIN, order.signable(identity.genesis)))


def _rank(keeper: Keeper) -> tuple[int, int, int, int, bytes]:
    return _order_of(keeper.held.version)


def _order_of(version: RecordVersion) -> tuple[int, int, int, int, bytes]:
    return version.epoch, version.seq, version.writer, version.session, version.digest


def _is_newer(present: RecordBytes | None, version: RecordVersion) -> bool:
    """Whether what lies at a place is that version or a newer one. What is damaged nobody can tell."""
    if present is None:
        return False
    try:
        return version_key(RecordHeader.decode(present.header)) >= _order_of(version)
    except DamagedData:
        return False
