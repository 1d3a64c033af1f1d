"""Group commit: changes that arrive while a commit is being synced share the next one.

One task takes changes from a bounded queue and hands a batch at a time to the writing thread. A sync costs about the
same for one record as for a hundred, so under load the batches grow by themselves, and a lone put waits for nobody.
A caller hears of its change only once the commit is durable.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar, cast

import trio

from scenefold.base.errors import LocalFault, Refused
from scenefold.base.ids import NodeId
from scenefold.base.limits import STORE_BATCH_BYTES_MAX, STORE_QUEUE_CHANGES_MAX
from scenefold.base.reasons import RejectReason
from scenefold.store.changes import NOTHING_LEFT, Change, MayUseReserve, ReserveLeft
from scenefold.store.layout import SpaceAddress
from scenefold.store.preallocation import ahead_of
from scenefold.store.sealing import StoreDamaged
from scenefold.store.statistics import Counts, room_beside
from scenefold.store.tally import Tally
from scenefold.world.ports import DiskFailed, DiskFull, Environment, ReadTransaction, Workers, WriteTransaction

R = TypeVar("R")

RIDE_S = 1.0
"""What rides along waits so long for somebody to go with."""
RIDERS_MAX = 256
"""Beyond that they go by themselves: their changes share the commit, and each may name some hundred records."""

SMALL_BYTES_MAX = 256 * 1024
"""A change that is no larger is tried again without the others where all together had no room."""

_log = logging.getLogger("scenefold.store")


@dataclass(slots=True, eq=False)
class _Waiting:
    """A caller and its change. `answer` is set before `done`; an exception in it is raised."""

    change: Change[Any]
    done: trio.Event = field(default_factory=trio.Event)
    answer: Any = None
    abandoned: bool = False

    def finish(self, answer: Any) -> None:
        self.answer = answer
        self.done.set()


@dataclass(frozen=True, slots=True)
class Committed:
    """Answers in the order of the changes, the new counts of the spaces that changed, how much nodes are owed
    where that changed, and how many met no room beside the reserve.

    `is_unbuilt`: this has left a tree of digests to be built.
    """

    answers: list[Any]
    counts: dict[SpaceAddress, Counts]
    owed: dict[NodeId, int]
    refused: int
    is_unbuilt: bool = False


class GroupWriter:
    """The store's only writer. `run` it in one task; `submit` from any number."""

    def __init__(self, workers: Workers, environment: Environment, reserve_bytes: int) -> None:
        self._workers = workers
        self._environment = environment
        self.reserve_bytes = reserve_bytes
        self._entrance, self._exit = trio.open_memory_channel[_Waiting](STORE_QUEUE_CHANGES_MAX)
        self.counts: dict[SpaceAddress, Counts] = {}
        self.owed: dict[NodeId, int] = {}
        self.commits = 0
        self._riders: list[_Waiting] = []
        self._ride_at = math.inf
        self._patience = trio.CancelScope()
        self._have_left = trio.Event()
        self._is_over = False
        self._is_full = False
        self.damage: StoreDamaged | None = None
        """Why nothing more is taken."""
        self.unbuilt = trio.Event()
        """Set when there is a tree of digests to be built."""

    async def submit(self, change: Change[R]) -> R:
        """Apply a change; returns when it is durable. Cancelled, the change may or may not happen."""
        waiting = _Waiting(change)
        try:
            await self._entrance.send(waiting)
        except (trio.BrokenResourceError, trio.ClosedResourceError):
            raise _closing() from None
        try:
            await waiting.done.wait()
        finally:
            waiting.abandoned = True
        if isinstance(waiting.answer, Exception):
            raise waiting.answer
        return cast(R, waiting.answer)

    async def ride_along(self, change: Change[Any]) -> None:
        """Let a change go with the next commit, or in one of its own a second from now at most. Nobody hears what became of it.

        Returns once it waits, at once but if too many do. It is lost with the process, or if the disk is full.
        """
        while len(self._riders) >= RIDERS_MAX:
            self._depart(trio.current_time())
            await self._have_left.wait()
        if self._is_over:
            raise _closing()
        self._riders.append(_Waiting(change))
        if len(self._riders) == 1:
            self._depart(trio.current_time() + RIDE_S)

    def _depart(self, when: float) -> None:
        self._ride_at = self._patience.deadline = when

    def halt(self, damage: StoreDamaged) -> None:
        """A reader has met damage that no node may go on with: take nothing more, and let `run` end with it."""
        self.damage = self.damage or damage
        self._entrance.close()

    async def run(self) -> None:
        """Commit until cancelled. A failing or damaged disk ends it with LocalFault: a node must not go on without one."""
        batch: list[_Waiting] = []
        try:
            while (first := await self._next()) is not None:
                batch = [waiting for waiting in self._gather(first) if not waiting.abandoned]
                if not batch:
                    continue
                committed = await self._workers.run(
                    "store", commit, self._environment, [waiting.change for waiting in batch], self.reserve_bytes
                )
                self.commits += 1
                self.counts.update(committed.counts)
                self.owed.update(committed.owed)
                if committed.is_unbuilt:
                    self.unbuilt.set()
                if not all(isinstance(waiting.change, MayUseReserve) for waiting in batch):
                    self._tell_of_fill(committed.refused)
                for waiting, answer in zip(batch, committed.answers, strict=True):
                    waiting.finish(answer)
                batch = []
            if self.damage is not None:
                raise self.damage
        except StoreDamaged as damage:
            self.damage = self.damage or damage
            _log.critical("%s", damage)
            raise
        except DiskFailed as error:
            _log.critical("%s", error)
            raise LocalFault(str(error), remedy="see to the disk, then start the node again") from error
        finally:
            self._dismiss(batch)

    def _tell_of_fill(self, refused: int) -> None:
        """One line when the disk fills up, one when there is room again; not one for each refusal."""
        if bool(refused) == self._is_full:
            return
        self._is_full = bool(refused)
        if refused:
            _log.error("the disk is full but for its reserve: new records are refused")
        else:
            _log.info("the disk has room again")

    async def _next(self) -> list[_Waiting] | None:
        """What a batch begins with: a change, and what waits to ride along. None once nothing more is taken."""
        came: list[_Waiting] = []
        with trio.CancelScope(deadline=self._ride_at) as self._patience:
            try:
                came.append(await self._exit.receive())
            except trio.EndOfChannel:
                return None
        came += self._riders
        self._riders, self._ride_at = [], math.inf
        self._have_left.set()
        self._have_left = trio.Event()
        return came

    def _gather(self, first: list[_Waiting]) -> list[_Waiting]:
        batch, size_bytes = first, sum(waiting.change.size_bytes for waiting in first)
        while size_bytes < STORE_BATCH_BYTES_MAX:
            try:
                waiting = self._exit.receive_nowait()
            except (trio.WouldBlock, trio.EndOfChannel):
                break
            batch.append(waiting)
            size_bytes += waiting.change.size_bytes
        return batch

    def _dismiss(self, batch: list[_Waiting]) -> None:
        # Nothing here awaits, so no caller can slip in between; later ones find the entrance broken.
        while True:
            try:
                batch.append(self._exit.receive_nowait())
            except (trio.WouldBlock, trio.EndOfChannel):
                break
        self._exit.close()
        self._is_over = True
        self._riders.clear()
        self._have_left.set()
        for waiting in batch:
            waiting.finish(_closing())


def commit(environment: Environment, changes: Sequence[Change[Any]], reserve_bytes: int) -> Committed:
    """Apply changes in one synced transaction (in the writing thread). What has no room is looked at, answered, not raised."""
    space = environment.space()
    room_bytes = room_beside(space, reserve_bytes)
    ahead_bytes = ahead_of(space.used, reserve_bytes)
    admitted: list[Change[Any]] = []
    for change in changes:
        if change.size_bytes > room_bytes:
            admitted.append(change.in_reserve(_left_of(room_bytes + reserve_bytes, ahead_bytes)))
        else:
            admitted.append(change)
        if admitted[-1] is change:
            room_bytes -= change.size_bytes
    refused = sum(sparing is not change for sparing, change in zip(admitted, changes, strict=True))

    try:
        return _commit(environment, admitted, refused)
    except DiskFull:
        return _commit_small(environment, changes)


def _commit(environment: Environment, changes: Sequence[Change[Any]], refused: int) -> Committed:
    def apply(transaction: WriteTransaction) -> Committed:
        tally = Tally()
        answers = [change.apply(transaction, tally) for change in changes]
        counts, owed = tally.write(transaction)
        return Committed(answers, counts, owed, refused, tally.digests.is_unbuilt)

    return environment.update(apply)


def _commit_small(environment: Environment, changes: Sequence[Change[Any]]) -> Committed:
    """All together had no room: do those that are small, and add nothing, by themselves. The rest is full."""
    small = {index: change.in_reserve(NOTHING_LEFT) for index, change in enumerate(changes) if change.size_bytes <= SMALL_BYTES_MAX}
    committed, answers = Committed([], {}, {}, 0), dict[int, Any]()
    if small and any(small.get(index) is not change for index, change in enumerate(changes)):
        try:
            committed = _commit(environment, list(small.values()), len(changes))
            answers = dict(zip(small, committed.answers, strict=True))
        except DiskFull:
            _log.debug("the disk has no room for what is small either")
    with environment.read() as view:
        full = [answers[index] if index in answers else _full(change, view) for index, change in enumerate(changes)]
    return replace(committed, answers=full, refused=len(changes))


def _left_of(free_bytes: int, ahead_bytes: int) -> ReserveLeft:
    """Half of what a store takes ahead is for who makes room, or lets others go on; the eighth above that for deletions beside these.

    The next eighth is for merged copies as well, so that what others have held here never keeps a gap from being recovered.
    """
    return ReserveLeft(free_bytes - ahead_bytes // 2, free_bytes - 3 * ahead_bytes // 4, free_bytes - 5 * ahead_bytes // 8)


def _full(change: Change[Any], view: ReadTransaction) -> Any:
    try:
        return change.when_full(view)
    except Refused as refusal:
        return refusal


def _closing() -> Refused:
    return Refused(RejectReason.NOT_READY, "the store is closing", remedy="try again once the node runs")
