"""The logs that several nodes decide, as the store keeps them (specs/10-store.md, Logs)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from scenefold.base.errors import Refused
from scenefold.base.ids import SceneId
from scenefold.base.reasons import RejectReason
from scenefold.store.changes import MayUseReserve, PutValue, storage_full
from scenefold.store.layout import HEADERS, IDENTITY, LOGS, NOTES, log_note, scene_key
from scenefold.store.log_reading import read_decided, read_log
from scenefold.store.log_rows import Decided, StoredLog, Votes, decided_key, pack_decided, pack_votes, votes_key
from scenefold.store.opened import OpenedStore
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


class LogStore(OpenedStore):
    """The part of the store that keeps logs. One task writes each of them. `opened_as`: the incarnation that the store was opened with."""

    opened_as: bytes

    async def read_log(self, genesis: bytes, above: int = 0) -> StoredLog | None:
        """What is decided above a position that the caller knows otherwise, and what is open; None if nothing was ever written of it here."""
        return await self._view(read_log, genesis, self.opened_as, above)

    async def decided(self, genesis: bytes, above: int, count_max: int, bytes_max: int) -> Sequence[Decided]:
        """What is decided above a position, with certificates: as many as fit, one at least if there is any."""
        return await self._view(read_decided, genesis, above, count_max, bytes_max)

    async def put_votes(self, genesis: bytes, votes: Votes) -> None:
        """What this node promises and votes for. Durable on return; Refused if the disk is full, or this incarnation over."""
        assert votes.incarnation == self.opened_as
        await self._writer.submit(PutLog(self.opened_as, (_votes(genesis, votes),)))

    async def put_decided(self, genesis: bytes, decided: Sequence[Decided], votes: Votes, beside: Beside = NOTHING_BESIDE) -> None:
        """What is decided, with all that follows from it, and the votes of the position behind it. One transaction, durable on return.

        Before the newest may stand others that are to be kept otherwise from now on.
        """
        assert (votes.incarnation, votes.position) == (self.opened_as, decided[-1].position + 1)
        rows = [PutValue(LOGS, decided_key(genesis, one.position), pack_decided(genesis, one)) for one in decided]
        await self._writer.submit(PutLog(self.opened_as, (*rows, _votes(genesis, votes), *beside.values())))


def _votes(genesis: bytes, votes: Votes) -> PutValue:
    return PutValue(LOGS, votes_key(genesis), pack_votes(genesis, votes))
