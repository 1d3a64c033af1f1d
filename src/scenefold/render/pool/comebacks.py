"""The organiser's side of nodes that come back: they are made ready beside the work, and join when nothing is open (specs/31-attempts.md, *Coming back*)."""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection
from dataclasses import dataclass

import trio

from scenefold.base.errors import ScenefoldError
from scenefold.base.ids import NodeId, address_of
from scenefold.render.job import Job
from scenefold.render.pool.company import ASK_S_MAX
from scenefold.render.pool.hold import PREPARE_S_MAX
from scenefold.render.pool.host import Host
from scenefold.render.pool.telling import error_of
from scenefold.wire import CancelJob, JobAnswer, JobEvent, JobState, JobStateReply, Packet, StartJob, Value, pack_value

LOOK_S = 2.0
LOOK_S_MAX = 16.0
"""Between two looks at a node that is lost; twice as long after each in vain."""
REST_S_MAX = 600.0
LASTING_S = 180.0
"""Who is lost again sooner than that after it joined is looked for later the next time: twice as late each time."""
ANSWERED_S = 4 * LOOK_S
"""Who is ready has answered within this time."""
COMEBACKS_MAX = 64
"""In a job. Whoever comes and goes is of no use."""

_log = logging.getLogger("scenefold.render.pool")


@dataclass(slots=True)
class _Away:
    """Of a node that takes no part: when to look again, and how long to wait then. `answered_s`: when it last did, once it is ready."""

    next_s: float
    pause_s: float
    answered_s: float | None = None
    is_looked_after: bool = False


class Comebacks:
    """Of one job. `lost`: those of its nodes that take no part. `is_worth`: whether so much is left to do that they should again."""

    def __init__(
        self, host: Host, job: Job, lost: Callable[[], Collection[NodeId]], is_worth: Callable[[], bool], begins: dict[str, Value]
    ) -> None:
        """`begins`: what all nodes were told when they began."""
        self._host, self._job, self._lost, self._is_worth, self._begins = host, job, lost, is_worth, begins
        self._away: dict[NodeId, _Away] = {}
        self._joined: dict[NodeId, float] = {}
        self._rests: dict[NodeId, float] = {}
        """How long to wait when they are lost again."""
        self._count = 0

    def ready(self) -> frozenset[NodeId]:
        """Those that are lost, and could join now."""
        now, lost = self._now(), self._lost()
        if not self._is_worth():
            return frozenset()
        away = ((node, away) for node, away in self._away.items() if node in lost and away.answered_s is not None)
        return frozenset(node for node, known in away if known.answered_s is not None and now - known.answered_s <= ANSWERED_S)

    def joined(self, nodes: Collection[NodeId]) -> None:
        """These take part again."""
        self._count += len(nodes)
        for node in nodes:
            self._away.pop(node, None)
            self._joined[node] = self._now()

    async def run(self) -> None:
        """Look after all that are lost, until cancelled."""
        async with trio.open_nursery() as nursery:
            while self._count < COMEBACKS_MAX:
                await self._host.world.clock.sleep(LOOK_S)
                lost, now = self._lost(), self._now()
                self._away = {node: self._away.get(node) or self._new(node, now) for node in lost}
                for node, away in self._away.items():
                    is_due = away.answered_s is not None or now >= away.next_s
                    if is_due and not away.is_looked_after and self._is_worth():
                        away.is_looked_after = True
                        nursery.start_soon(self._look_after, node, away)

    def _new(self, node: NodeId, now: float) -> _Away:
        joined = self._joined.pop(node, None)
        if joined is None or now - joined > LASTING_S:
            self._rests.pop(node, None)
            return _Away(now, LOOK_S)
        rest = self._rests[node] = min(2 * self._rests.get(node, LOOK_S), REST_S_MAX)
        return _Away(now + rest, LOOK_S)

    async def _look_after(self, node: NodeId, away: _Away) -> None:
        """Whoever is not ready cannot join meanwhile."""
        try:
            if away.answered_s is not None:
                # It would end its part if nobody spoke of it.
                await self._ask(node, JobState(job=self._job.id), ASK_S_MAX)
            elif node in self._lost():
                await self._prepare(node)
            away.answered_s, away.pause_s = self._now(), LOOK_S
        except ScenefoldError as error:
            away.answered_s = None
            away.next_s, away.pause_s = self._now() + away.pause_s, min(2 * away.pause_s, LOOK_S_MAX)
            _log.debug("job %016x: %s is not back: %s", self._job.id, address_of(node), error)
        finally:
            away.is_looked_after = False

    def _now(self) -> float:
        return self._host.world.clock.now()

    async def _prepare(self, node: NodeId) -> None:
        """A part that knows nothing of what was before. It traces nothing: no pass is released to it."""
        job = self._job.id
        await self._ask(node, CancelJob(job=job), ASK_S_MAX)
        await self._ask(node, StartJob(job=job, document=self._job.to_bytes()), PREPARE_S_MAX)
        await self._ask(node, JobEvent(job=job, document=pack_value({**self._begins, "from": 0})), ASK_S_MAX)

    async def _ask(self, node: NodeId, packet: Packet, timeout_s: float) -> None:
        answer = await self._host.ask(node, packet, timeout_s)
        if isinstance(answer, JobAnswer) and answer.reason:
            raise error_of(answer.reason, answer.text, where=address_of(node))
        if not isinstance(answer, JobAnswer | JobStateReply):
            raise error_of(0, f"{type(answer).__name__} is no answer to {type(packet).__name__}", where=address_of(node))
