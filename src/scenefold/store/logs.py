"""The logs that several nodes decide, as the store keeps them (specs/10-store.md, Logs)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from scenefold.base.errors import Refused
from scenefold.base.ids import SceneId
from scenefold.base.reasons import RejectReason
from scenefold.store.changes import MayUseReserve, PutValue, storage_full
from scenefold.store.layout import HEADERS, IDENTITY, LOGS, NOTES, log_note, scene_key
from scenefold.store.log_reading import read_decided, read_kept, read_log, read_names
from scenefold.store.log_rows import POSITION_MAX, Decided, StoredLog, Votes, decided_key, pack_decided, pack_votes, votes_key
from scenefold.store.opened import OpenedStore
from scenefold.store.reading import read_value
from scenefold.store.tally import Tally
from scenefold.world.ports import ReadTransaction, WriteTransaction


@dataclass(frozen=True, slots=True)
class Beside:
    """What else follows from a value that is decided, and must not be of another position: a scene's header and sealed log, notes."""

    headers: Mapping[SceneId, bytes] = field(default_factory=dict)
    logs: Mapping[SceneId, bytes] = field(default_factory=dict)
    notes: Mapping[str, bytes] = field(default_factory=dict)

    def values(self) -> tuple[PutValue, ...]:
        headers = [PutValue(HEADERS, scene_key(scene), header) for scene, header in self.headers.items()]
        logs = [PutValue(NOTES, log_note(scene), log) for scene, log in self.logs.items()]
        return (*headers, *logs, *(PutValue(NOTES, name.encode(), note) for name, note in self.notes.items()))


NOTHING_BESIDE = Beside()


@dataclass(frozen=True, slots=True)
class PutLog(MayUseReserve):
    """Rows of a log, all or none, if they are of the incarnation that the store has still; else Refused, and nothing changes."""

    incarnation: bytes
    values: tuple[PutValue, ...]

    @property
    def size_bytes(self) -> int:
        return sum(value.size_bytes for value in self.values)

    def apply(self, transaction: WriteTransaction, tally: Tally, /) -> Refused | None:
        if bytes(transaction.get(IDENTITY, b"incarnation") or b"") != self.incarnation:
            return Refused(RejectReason.NOT_READY, "this incarnation of the node is over", remedy="try again once the node runs")
        for value in self.values:
            value.apply(transaction, tally)
        return None

    def when_full(self, _transaction: ReadTransaction, /) -> None:
        raise storage_full()


@dataclass(frozen=True, slots=True)
class BeginLog(PutLog):
    """Likewise, without what was decided of that log so far."""

    genesis: bytes

    def apply(self, transaction: WriteTransaction, tally: Tally, /) -> Refused | None:
        # `super()` knows no class with slots.
        refused = PutLog.apply(self, transaction, tally)
        if refused is None:
            for key in list(transaction.keys(LOGS, decided_key(self.genesis, 1), decided_key(self.genesis, POSITION_MAX))):
                transaction.delete(LOGS, key)
        return refused


@dataclass(frozen=True, slots=True)
class PutSceneLog(MayUseReserve):
    """A scene's sealed log, if the header that it goes with is still the one that is kept."""

    scene: SceneId
    header: bytes
    private: bytes

    @property
    def size_bytes(self) -> int:
        return len(self.private)

    def apply(self, transaction: WriteTransaction, tally: Tally, /) -> bool:
        if bytes(transaction.get(HEADERS, scene_key(self.scene)) or b"") != self.header:
            return False
        PutValue(NOTES, log_note(self.scene), self.private).apply(transaction, tally)
        return True

    def when_full(self, _transaction: ReadTransaction, /) -> bool:
        raise storage_full()


class LogStore(OpenedStore):
    """The part of the store that keeps logs. One task writes each of them. `opened_as`: the incarnation that the store was opened with."""

    opened_as: bytes

    async def read_log(self, genesis: bytes, above: int = 0) -> StoredLog | None:
        """What is decided above a position that the caller knows otherwise, and what is open; None if nothing was ever written of it here."""
        return await self._view(read_log, genesis, self.opened_as, above)

    async def decided(self, genesis: bytes, above: int, count_max: int, bytes_max: int) -> Sequence[Decided]:
        """What is decided above a position, with certificates: as many as fit, one at least if there is any."""
        return await self._view(read_decided, genesis, above, count_max, bytes_max)

    async def kept_decisions(self, genesis: bytes, above: int, count_max: int, bytes_max: int) -> Sequence[Decided]:
        """What is kept of that, for people: what lacks or is damaged is left out."""
        return await self._view(read_kept, genesis, above, count_max, bytes_max)

    async def logs_kept(self) -> frozenset[bytes]:
        """The genesis of each log of which anything is kept."""
        return await self._view(read_names)

    async def scene_with_log(self, scene: SceneId) -> tuple[bytes, bytes] | None:
        """A scene's header and its sealed log, both of one moment; None unless both are there."""
        return await self._view(_read_scene, scene)

    async def keep_scene_log(self, scene: SceneId, header: bytes, private: bytes) -> bool:
        """Keep the sealed log that goes with a header; False, and nothing changes, if another header is kept by now."""
        return await self._writer.submit(PutSceneLog(scene, header, private))

    async def put_votes(self, genesis: bytes, votes: Votes) -> None:
        """What this node promises and votes for. Durable on return; Refused if the disk is full, or this incarnation over."""
        assert votes.incarnation == self.opened_as
        await self._writer.submit(PutLog(self.opened_as, (_votes(genesis, votes),)))

    async def begin_log(self, genesis: bytes, votes: Votes, beside: Beside) -> None:
        """Have the log begin at a later position, with what follows from the one before that; what was decided before is kept no longer.

        One transaction; Refused as of `put_votes`.
        """
        assert votes.incarnation == self.opened_as
        await self._writer.submit(BeginLog(self.opened_as, (_votes(genesis, votes), *beside.values()), genesis))

    async def put_decided(self, genesis: bytes, decided: Sequence[Decided], votes: Votes, beside: Beside = NOTHING_BESIDE) -> None:
        """What is decided, with all that follows from it, and the votes of the position behind it. One transaction, durable on return.

        Before the newest may stand others that are to be kept otherwise from now on.
        """
        assert (votes.incarnation, votes.position) == (self.opened_as, decided[-1].position + 1)
        rows = [PutValue(LOGS, decided_key(genesis, one.position), pack_decided(genesis, one)) for one in decided]
        await self._writer.submit(PutLog(self.opened_as, (*rows, _votes(genesis, votes), *beside.values())))


def _votes(genesis: bytes, votes: Votes) -> PutValue:
    return PutValue(LOGS, votes_key(genesis), pack_votes(genesis, votes))


def _read_scene(transaction: ReadTransaction, scene: SceneId) -> tuple[bytes, bytes] | None:
    header, private = read_value(transaction, HEADERS, scene_key(scene)), read_value(transaction, NOTES, log_note(scene))
    return None if header is None or private is None else (header, private)
