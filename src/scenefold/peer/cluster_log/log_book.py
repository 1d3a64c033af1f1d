"""The cluster's log as this node keeps it: signed records, in pages of notes (specs/15-cluster-log.md, Learning).

A page holds PAGE_RECORDS records; appending rewrites the last page only. Pages and header are written in one transaction, so
neither a crash nor a disk that fills up leaves more, or less, than what this node goes on with. `verified` is what stands between other nodes' bytes and the log.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.limits import LOG_RECORDS_MAX
from scenefold.base.reasons import RejectReason
from scenefold.crypto import LOG_DOMAIN, PublicKey
from scenefold.peer.cluster_log.registry import Registry
from scenefold.store import Store
from scenefold.wire import LogRecord, MalformedPacket, SceneLogPublic, SignedRecord, hash_of_record, pack_log, unpack_log

PAGE_RECORDS = 64
"""About 16 KiB: small enough to write anew for one record, large enough to load a thousand in a few reads."""
PART_BYTES_MAX = 1024 * 1024
"""Of the log in one packet; who needs more asks again."""
_REMEMBERED_RECORDS = 2_048
_HEADER_NOTE = "cluster-log/header"


class LogBook:
    """All signed records from the first on. One task writes at a time (cluster_log.py holds a lock)."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._records: list[SignedRecord] = []

    @property
    def count(self) -> int:
        return len(self._records)

    async def load(self) -> Sequence[SignedRecord]:
        """Read what is on the disk. DamagedData if it cannot be read."""
        page = 0
        while (data := await self._store.get_note(_note(page))) is not None:
            try:
                self._records += unpack_log(data)
            except MalformedPacket as problem:
                raise DamagedData("the stored log of the cluster is damaged", where=_note(page)) from problem
            page += 1
        return tuple(self._records)

    async def append(self, records: Sequence[SignedRecord], header: SceneLogPublic | None) -> None:
        """Make more records durable, and a newer header if there is one: all of that, or nothing."""
        first = len(self._records) // PAGE_RECORDS
        whole = [*self._records[first * PAGE_RECORDS :], *records]
        notes = {
            _note(first + start // PAGE_RECORDS): pack_log(whole[start : start + PAGE_RECORDS])
            for start in range(0, len(whole), PAGE_RECORDS)
        }
        if header is not None:
            notes[_HEADER_NOTE] = header.encode()
        await self._store.put_notes(notes)
        self._records += records

    def part(self, have: int) -> bytes:
        """The records behind position `have` as they travel: as many as one packet takes, at least one if there is one."""
        chosen: list[SignedRecord] = []
        size = 0
        for record in self._records[have : have + LOG_RECORDS_MAX]:
            size += len(record.record) + len(record.signature) + 16
            if chosen and size > PART_BYTES_MAX:
                break
            chosen.append(record)
        return pack_log(chosen)

    def hash_at(self, position: int) -> bytes:
        """The hash of a record that is here."""
        return hash_of_record(self._records[position - 1].record)

    async def header(self) -> SceneLogPublic | None:
        """The newest signed header that was kept."""
        data = await self._store.get_note(_HEADER_NOTE)
        try:
            return None if data is None else SceneLogPublic.decode(data)
        except MalformedPacket as problem:
            raise DamagedData("the stored header of the cluster's log is damaged", where=_HEADER_NOTE) from problem


def verified(registry: Registry, records: Sequence[SignedRecord], key: PublicKey) -> tuple[Registry, list[SignedRecord]]:
    """The registry after those of the records that it lacks, and these.

    MalformedPacket, InvalidSignature, or Refused (a gap or another chain, or the key decides no more): then nothing of them counts.
    """
    fresh: list[SignedRecord] = []
    decoded: list[LogRecord] = []
    for signed in records:
        record = _opened(key, signed)
        if record.position > registry.position:
            fresh.append(signed)
            decoded.append(record)
    after = registry.extended(decoded)
    if fresh and after.position > after.voting.certified_from:
        what = f"behind position {after.voting.certified_from} voters decide the cluster's log, and its key does not any more"
        raise Refused(RejectReason.NOT_AUTHORISED, what)
    return after, fresh


@lru_cache(maxsize=_REMEMBERED_RECORDS)
def _opened(key: PublicKey, signed: SignedRecord) -> LogRecord:
    """The record inside. Remembered: it is met again at every push of its neighbours, and by all nodes of a simulation."""
    key.verify(signed.signature, LOG_DOMAIN, signed.record)
    return signed.decoded()


def _note(page: int) -> str:
    return f"cluster-log/{page:08d}"
