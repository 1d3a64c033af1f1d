"""The cluster's log behind the newest record of its key, at any node: who votes takes part in it, all others learn it
(specs/15-cluster-log.md, Voters; specs/25-consensus.md, On a node)."""

from __future__ import annotations

import logging
from collections import OrderedDict
from collections.abc import Callable
from typing import Protocol

import trio

from scenefold.base.errors import Refused
from scenefold.base.limits import DECIDED_MAX, LOG_BYTES_MAX
from scenefold.consensus import Decide, Judge, Learn, Setting
from scenefold.consensus.packets import decided_page, decided_value
from scenefold.peer.cluster_log.cluster_judge import ClusterJudge
from scenefold.peer.cluster_log.lease_desk import LeaseDesk
from scenefold.peer.cluster_log.registry import Registry
from scenefold.peer.cluster_log.voter_owner import VoterOwner
from scenefold.peer.logs import AT_ONCE_BYTES, Carrier, Log, Logs, Surroundings, open_log
from scenefold.peer.logs.intake import Intake
from scenefold.peer.membership.status import OwnStatus
from scenefold.peer.waiters import Waiters
from scenefold.store import Store
from scenefold.wire import NO_RECORD, DecidedLog, DecidedValue
from scenefold.world import World

RECENT = 256
"""The newest positions, which are told to whoever lacks them without a look at the disk."""
DISK_PAUSE_S = 1.0

_log = logging.getLogger("scenefold.peer.cluster_log.cluster_log")


class Ports(Protocol):
    """All that logs need of their node (peer/logs/links.py)."""

    @property
    def logs(self) -> Logs: ...
    @property
    def carrier(self) -> Carrier: ...
    @property
    def around(self) -> Surroundings: ...
    @property
    def intake(self) -> Intake: ...


class VotedLog:
    """`open` it, then `run` it in one task. `log` and `desk` are there once it is opened."""

    log: Log
    desk: LeaseDesk

    def __init__(self, world: World, store: Store, own: OwnStatus, ports: Ports, genesis: bytes) -> None:
        self._world, self._store, self._own, self._ports, self._genesis = world, store, own, ports, genesis
        self.owner = VoterOwner(world)
        self.owner.heard = self._has_decided
        self.heard: Callable[[Registry, Decide], None] = lambda _registry, _decided: None
        """Called with the log as it is behind what is decided."""
        self.opened = trio.Event()
        self._recent: OrderedDict[int, DecidedValue] = OrderedDict()
        self._news = Waiters()

    @property
    def registry(self) -> Registry:
        """All that is decided here, durably."""
        return _registry_of(self.log.judge)

    @property
    def is_voter(self) -> bool:
        """Whether this node decides the next position, awake or not."""
        return self.opened.is_set() and self._own.member in self.log.judge.participants

    async def open(self, registry: Registry) -> None:
        """`registry`: as of the newest record of the log's key. A disk that is full is waited for; DamagedData if what was decided makes no sense."""
        while True:
            try:
                await self._open(registry)
                return
            except Refused as problem:
                _log.warning("the cluster's log is not opened: %s", problem)
                await self._world.clock.sleep(DISK_PAUSE_S)

    async def _open(self, registry: Registry) -> None:
        me, ports = self._own.member, self._ports
        setting, judge = Setting(self._genesis, me, self._own.key, at_once_bytes=AT_ONCE_BYTES), ClusterJudge(registry)
        log = await open_log(self._world, self._store, setting, judge, ports.carrier, ports.around, self.owner, position=registry.position)
        desk = LeaseDesk(self._world, self._store, me, lambda: _registry_of(log.judge), lambda: self.owner.has_accepted)
        if any(me in council.voters for council in _registry_of(log.judge).voting.councils):
            await desk.load()
        self.owner.desk, desk.woke = desk, log.restate
        self.log, self.desk = log, desk
        self.opened.set()

    async def run(self, *, task_status: trio.TaskStatus[None] = trio.TASK_STATUS_IGNORED) -> None:
        """Until cancelled. An error of the disk ends it, and with that the node."""
        self._ports.logs.add(self.log)
        try:
            async with trio.open_nursery() as nursery:
                nursery.start_soon(self.owner.run)
                await nursery.start(self.log.run)
                task_status.started()
        finally:
            self._ports.logs.remove(self._genesis)

    async def come_to(self, position: int) -> None:
        """Return once so much is decided here."""
        await self._news.until(lambda: self.log.position >= position)

    def _has_decided(self, decided: Decide, after: Judge) -> None:
        told = decided_value(Learn(self._genesis, decided.position, decided.value, decided.certificate))
        self._recent[decided.position] = told
        if len(self._recent) > RECENT:
            self._recent.popitem(last=False)
        self.heard(_registry_of(after), decided)
        self._news.tell()

    # ------------------------------------------------------------------------------------------------------ telling

    def recent(self, have: int) -> DecidedLog:
        """What is decided above a position, for whoever may lack it: all if it was decided lately, else the newest, so that he asks."""
        newest = self.log.position
        begin = have + 1 if have + 1 in self._recent else newest
        return decided_page(self._genesis, newest, [self._recent[at] for at in range(begin, newest + 1) if at in self._recent])

    def hash_at(self, position: int) -> bytes:
        """The hash of a record that was decided lately; that of none otherwise."""
        told = self._recent.get(position)
        return NO_RECORD if told is None else told.value.digest

    async def page(self, have: int) -> DecidedLog:
        """What is decided above a position, as much as fits, with what shows it."""
        rows = await self._store.decided(self._genesis, have, DECIDED_MAX, LOG_BYTES_MAX)
        told = [decided_value(Learn(self._genesis, row.position, row.value, row.certificate)) for row in rows]
        return decided_page(self._genesis, self.log.position, told)


def _registry_of(judge: Judge) -> Registry:
    assert isinstance(judge, ClusterJudge)
    return judge.registry
