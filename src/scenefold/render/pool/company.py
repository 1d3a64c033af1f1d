"""The nodes of a job that live, as its organiser speaks to them: all at once, and it notices who is lost (specs/31-attempts.md)."""

from __future__ import annotations

from collections import Counter
from collections.abc import AsyncIterator, Collection, Sequence
from contextlib import asynccontextmanager
from typing import NamedTuple

import trio

from scenefold.base.errors import PeerFault, Refused, ScenefoldError, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.base.plain_values import text, whole
from scenefold.base.reasons import RejectReason
from scenefold.partition.division import Division
from scenefold.render.arrays import F32
from scenefold.render.job import Job
from scenefold.render.pool.hit_sample import hits_of_bytes, kept_in
from scenefold.render.pool.host import Host
from scenefold.render.pool.roster import Roster
from scenefold.render.pool.telling import error_of
from scenefold.wire import JobAnswer, JobEvent, JobState, JobStateReply, Packet, Value, pack_value, unpack_value
from scenefold.world import leaves

ASK_S_MAX = 30.0
WATCH_S = 1.0
"""Between two looks at nodes of which something else is awaited."""


class NodesLost(Exception):
    """Some nodes of a job died, or might as well have. `error`: what came of asking one of them."""

    def __init__(self, nodes: Collection[NodeId], error: ScenefoldError) -> None:
        super().__init__(str(error))
        self.nodes, self.error = frozenset(nodes), error


class NodesBack(Exception):
    """Some nodes of a job that were lost are ready to take part again, and nothing is open."""

    def __init__(self, nodes: Collection[NodeId]) -> None:
        super().__init__("nodes are back")
        self.nodes = frozenset(nodes)


class Apart(NamedTuple):
    """A node says that it does not reach another one."""

    by: NodeId
    other: NodeId
    words: str


_ADDED = (
    "casts", "rays", "shadow_casts", "rays_sent", "packets_sent", "packets_resent", "rays_received", "late", "not_finite", "clamped",
    "busy_seconds", "processor_seconds", "bytes_read",
)  # fmt: skip
"""What a node counts in all, from the beginning of its life."""


class Company:
    """Of one job."""

    def __init__(self, host: Host, job: Job) -> None:
        self._host, self._job = host, job
        self.roster = Roster.first(job, host.node_id)
        self.states: dict[NodeId, dict[str, Value]] = {}
        """The newest of each node, also of those that are lost."""
        self._before: dict[NodeId, dict[str, int | float]] = {}
        """Of those that were lost and are back: what they had counted until then."""
        self.hits: dict[NodeId, F32] = {}
        self.done: dict[NodeId, Value] = {}
        """The passes in each node's film, while an attempt is held; too many for what clients are told."""
        self.occupied: dict[NodeId, Value] = {}
        """Where each node holds something, before it traces."""

    @property
    def nodes(self) -> tuple[NodeId, ...]:
        """Those that take part."""
        return self.roster.nodes

    def take_occupied(self, division: Division) -> list[Value]:
        """What nodes told of where they hold something, if that is all of the scene: all nodes of a pool have; else empty."""
        told = [self.occupied.get(node) for node in self.nodes]
        self.occupied.clear()
        is_all = any(all(told[place] for place in places) for places in division.ranges)
        return [one for one in told if one] if is_all else []

    def is_back(self, node: NodeId) -> None:
        """It counts from nothing; what it had told before it was lost is not forgotten."""
        before, last = self._before.get(node, {}), self.states.pop(node, {})
        self._before[node] = {name: before.get(name, 0) + _amount(last.get(name)) for name in _ADDED}

    def whole_states(self) -> dict[NodeId, dict[str, Value]]:
        """The newest of each node that has told any, with what it did before it was lost and came back."""
        return {node: self._with_before(node) for node in {**self._before, **self.states}}

    def _with_before(self, node: NodeId) -> dict[str, Value]:
        state, before = self.states.get(node, {}), self._before.get(node)
        return state if before is None else {**state, **{name: before[name] + _amount(state.get(name)) for name in _ADDED}}

    def states_of(self, nodes: Collection[NodeId]) -> dict[NodeId, dict[str, Value]]:
        """The newest of each of these; nothing of one that has told none."""
        return {node: self.states.get(node, {}) for node in nodes}

    async def tell(self, document: dict[str, Value], timeout_s: float = ASK_S_MAX) -> None:
        """An event of the job that every node must take; the first refusal is ours. NodesLost."""
        await self.ask(JobEvent(job=self._job.id, document=pack_value(document)), timeout_s)

    async def ask(self, packet: Packet, timeout_s: float) -> None:
        """All nodes, and all must agree. NodesLost."""
        lost = _Lost(self._host)

        async def ask(node: NodeId) -> None:
            answer = await lost.answer(node, packet, timeout_s)
            if answer is None:
                return
            if not isinstance(answer, JobAnswer):
                raise PeerFault(f"{type(answer).__name__} is no answer to {type(packet).__name__}", where=address_of(node))
            if answer.reason:
                raise error_of(answer.reason, answer.text, where=address_of(node))

        async with trio.open_nursery() as nursery:
            for node in self.nodes:
                nursery.start_soon(ask, node)
        lost.check()

    async def look(self) -> None:
        """How all nodes stand. What one of them failed of is raised, unless it is that another one could not be reached. NodesLost."""
        lost = _Lost(self._host)
        away: list[Apart] = []

        async def look(node: NodeId) -> None:
            reply = await lost.answer(node, JobState(job=self._job.id), ASK_S_MAX)
            if reply is None:
                return
            if not isinstance(reply, JobStateReply):
                raise PeerFault(f"{type(reply).__name__} is no answer to JobState", where=address_of(node))
            state = unpack_value(reply.document, what="a job's state")
            if not isinstance(state, dict):
                raise PeerFault("a job's state is ill-formed", where=address_of(node))
            if state.get("failure"):
                reason = state.get("failure_reason")
                lost.note(node, error_of(reason if isinstance(reason, int) else 0, str(state["failure"]), where=address_of(node)))
                return
            if state.get("attempt", self.roster.attempt) != self.roster.attempt:
                lost.note(node, Unreachable("the node takes part in another attempt of the job", where=address_of(node)))
                return
            away.extend(Apart(node, other, words) for other, words in _away(state.pop("away", [])) if other in self.nodes)
            self.done[node] = state.pop("film", None)
            self.occupied[node] = state.pop("occupied", None)
            hits = state.pop("hits", None)
            if self._job.moves and hits is not None:
                self.hits[node] = hits_of_bytes(hits, kept_in(self._job))
            self.states[node] = state

        async with trio.open_nursery() as nursery:
            for node in self.nodes:
                nursery.start_soon(look, node)
        for node, apart in who_go(away, self.roster.organiser).items():
            lost.note(node, Unreachable(apart.words, where=address_of(apart.by)))
        lost.check()

    @asynccontextmanager
    async def watched(self) -> AsyncIterator[None]:
        """While something is awaited that a lost node might keep us waiting for. NodesLost, as a group."""
        async with trio.open_nursery() as nursery:
            nursery.start_soon(self._watch)
            yield
            nursery.cancel_scope.cancel()

    async def _watch(self) -> None:
        while True:
            await self._host.world.clock.sleep(WATCH_S)
            await self.look()


def who_go(away: Sequence[Apart], organiser: NodeId) -> dict[NodeId, Apart]:
    """Of each two that do not reach each other one must go, never the organiser: whoever is in most pairs, until none is left. With what was said of it."""
    pairs = {frozenset((apart.by, apart.other)): apart for apart in away if apart.by != apart.other}
    gone: dict[NodeId, Apart] = {}
    while pairs:
        counts = Counter(node for pair in pairs for node in pair if node != organiser)
        node = max(counts, key=lambda node: (counts[node], node))
        gone[node] = next(apart for pair, apart in pairs.items() if node in pair)
        pairs = {pair: apart for pair, apart in pairs.items() if node not in pair}
    return gone


def lost_of(error: BaseException) -> NodesLost | None:
    """Who was lost, if nothing else happened: what failed because of them is no other error. Who is back can wait. None else."""
    found = list(leaves(error)) if isinstance(error, BaseExceptionGroup) else [error]
    lost = [one for one in found if isinstance(one, NodesLost)]
    if not lost or not all(isinstance(one, NodesLost | NodesBack) or is_away(one) for one in found):
        return None
    return NodesLost({node for one in lost for node in one.nodes}, lost[0].error)


def back_of(error: BaseException) -> NodesBack | None:
    """Who is back, if nothing else happened."""
    found = list(leaves(error)) if isinstance(error, BaseExceptionGroup) else [error]
    back = [one for one in found if isinstance(one, NodesBack)]
    return back[0] if len(back) == len(found) else None


def is_away(error: BaseException) -> bool:
    """Whether an error says that somebody is not there, or not yet: it may pass."""
    return isinstance(error, Unreachable) or (isinstance(error, Refused) and error.reason is RejectReason.NOT_READY)


def _away(rows: object) -> list[tuple[NodeId, str]]:
    """Whom a node cannot reach, as it tells it. PeerFault if that is ill-formed."""
    try:
        if not isinstance(rows, list):
            raise TypeError("a list is expected")
        return [(NodeId(whole(node, 0, 2**32 - 1)), text(words)) for node, words in rows]
    except (TypeError, ValueError) as error:
        raise PeerFault("a job's state is ill-formed", where=f"away: {error}") from error


class _Lost:
    """Who was lost when all were asked at once."""

    def __init__(self, host: Host) -> None:
        self._host = host
        self._errors: dict[NodeId, ScenefoldError] = {}

    async def answer(self, node: NodeId, packet: Packet, timeout_s: float) -> Packet | None:
        """None of a node that is lost."""
        try:
            return await self._host.ask(node, packet, timeout_s)
        except ScenefoldError as error:
            self.note(node, error)
            return None

    def note(self, node: NodeId, error: ScenefoldError) -> None:
        """What does not say that the node is lost is raised."""
        if not is_away(error):
            raise error
        self._errors[node] = error

    def check(self) -> None:
        """NodesLost if somebody was."""
        if self._errors:
            raise NodesLost(self._errors, next(iter(self._errors.values())))


def _amount(value: Value | None) -> int | float:
    return value if isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value < 2**63 else 0
