"""The organiser's side of nodes that come back: they are made ready beside the work, and join when nothing is open (specs/31-attempts.md, *Coming back*)."""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection
from dataclasses import dataclass

from scenefold.base.errors import ScenefoldError
from scenefold.base.ids import NodeId, address_of
from scenefold.render.job import Job
from scenefold.render.pool.company import ASK_S_MAX
from scenefold.render.pool.hold import PREPARE_S_MAX
from scenefold.render.pool.host import Host
from scenefold.render.pool.telling import error_of
from scenefold.wire import CancelJob, JobAnswer, JobEvent, JobState, JobStateReply, Packet, StartJob, pack_value

LOOK_S = 2.0
LOOK_S_MAX = 16.0
"""Between two looks at a node that is lost; twice as long after each in vain."""
COMEBACKS_MAX = 64
"""In a job. Whoever comes and goes is of no use."""

_log = logging.getLogger("scenefold.render.pool")


@dataclass(slots=True)
class _Away:
    """Of a node that takes no part: when to look again, and how long to wait then."""

    next_s: float
    pause_s: float = LOOK_S


class Comebacks:
    """Of one job. `lost`: those of its nodes that take no part. `is_worth`: whether so much is left to do that they should again."""

    def __init__(self, host: Host, job: Job, lost: Callable[[], Collection[NodeId]], is_worth: Callable[[], bool]) -> None:
        self._host, self._job, self._lost, self._is_worth = host, job, lost, is_worth
        self._away: dict[NodeId, _Away] = {}
        self._ready: set[NodeId] = set()
        self._count = 0

    def ready(self) -> frozenset[NodeId]:
        """Those that are lost, and could join now."""
        return frozenset(self._ready & set(self._lost())) if self._is_worth() else frozenset()

    def joined(self, nodes: Collection[NodeId]) -> None:
        """These take part again."""
        self._ready -= set(nodes)
        self._count += len(nodes)

    async def run(self) -> None:
        """Look after all that are lost, until cancelled."""
        clock = self._host.world.clock
        while self._count < COMEBACKS_MAX:
            await clock.sleep(LOOK_S)
            lost, now = self._lost(), clock.now()
            self._ready &= set(lost)
            self._away = {node: self._away.get(node, _Away(now)) for node in lost}
            for node, away in self._away.items():
                if (node in self._ready or now >= away.next_s) and self._is_worth():
                    await self._look_after(node, away)

    async def _look_after(self, node: NodeId, away: _Away) -> None:
        try:
            if node in self._ready:
                # It would end its part if nobody spoke of it.
                await self._ask(node, JobState(job=self._job.id), ASK_S_MAX)
                return
            await self._prepare(node)
        except ScenefoldError as error:
            self._ready.discard(node)
            away.next_s, away.pause_s = self._host.world.clock.now() + away.pause_s, min(2 * away.pause_s, LOOK_S_MAX)
            _log.debug("job %016x: %s is not back: %s", self._job.id, address_of(node), error)
            return
        self._ready.add(node)
        away.pause_s = LOOK_S

    async def _prepare(self, node: NodeId) -> None:
        """A part that knows nothing of what was before. It traces nothing: no pass is released to it."""
        job = self._job.id
        await self._ask(node, CancelJob(job=job), ASK_S_MAX)
        await self._ask(node, StartJob(job=job, document=self._job.to_bytes()), PREPARE_S_MAX)
        await self._ask(node, JobEvent(job=job, document=pack_value({"go": True, "from": 0})), ASK_S_MAX)

    async def _ask(self, node: NodeId, packet: Packet, timeout_s: float) -> None:
        answer = await self._host.ask(node, packet, timeout_s)
        if isinstance(answer, JobAnswer) and answer.reason:
            raise error_of(answer.reason, answer.text, where=address_of(node))
        if not isinstance(answer, JobAnswer | JobStateReply):
            raise error_of(0, f"{type(answer).__name__} is no answer to {type(packet).__name__}", where=address_of(node))
