"""Who keeps a scene's sealed log, and the newest that they show (specs/16-scene-log.md, Author).

As long as nobody else decides, that is the scene's origin. Else each of its participants has what it knows to be decided; one that lags
shows an older log, as well decided as the newest. So several of them are asked how far they are, and the one that is furthest for the log.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from functools import partial
from typing import Generic, NamedTuple, TypeVar

from scenefold.base.errors import DamagedData, PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.base.limits import CLIENT_ASKED_MAX, CLIENT_NEXT_S, CLIENT_OPINION_S, CLIENT_OPINIONS, CLIENT_REQUEST_S, CLIENT_STATUS_S
from scenefold.base.reasons import RejectReason
from scenefold.client.calls import Calls
from scenefold.client.hedging import first_answer, some_answers
from scenefold.wire import RequestSceneLog, RespondSceneLog, SceneLogAnswer, SceneLogPublic, Want
from scenefold.world import Priority

Log = TypeVar("Log")

SILENT_S = 10.0
_OLD_LOGS_MAX = 3


class Shown(NamedTuple):
    """A header that was verified, and who showed it."""

    public: SceneLogPublic
    address: str


class LogKeepers(Generic[Log]):
    """Of one scene."""

    def __init__(
        self,
        calls: Calls,
        name: str,
        request: Callable[[Want], RequestSceneLog],
        forbids: Callable[[SceneLogPublic], bool],
        verified: Callable[[SceneLogPublic], SceneLogPublic],
        opened: Callable[[SceneLogPublic, bytes], Awaitable[Log]],
    ) -> None:
        """`forbids`: what must not count, by what was met before; `verified`: the header, or another one in its place if it must not.

        `opened`: what a header's sealed log holds; DamagedData if it does not verify.
        """
        self._calls, self._name, self._request = calls, name, request
        self._forbids, self._verified, self._opened = forbids, verified, opened

    def in_order(self, public: SceneLogPublic, first: NodeId | None = None) -> list[NodeId]:
        """The participants that follow a header: `first`, then by their ids, so that all who ask begin with the same one; who was silent, last."""
        nodes = [entry.member.node for entry in public.participants]
        return sorted(nodes, key=lambda node: (node != first, self._calls.is_silent(node), node))

    def to_propose(self, public: SceneLogPublic) -> list[NodeId]:
        """The same, for whoever has something to be decided: from the middle outwards, since the one there needs no promises.

        Who was silent is passed over for a while only: authors who begin with different ones hold each other up.
        """
        nodes = sorted(entry.member.node for entry in public.participants)
        far = {node: abs(2 * index - len(nodes) + 1) for index, node in enumerate(nodes)}
        return sorted(nodes, key=lambda node: (self._calls.is_silent(node, within_s=SILENT_S), far[node], node))

    async def newest(self, known: SceneLogPublic, read: SceneLogPublic | None, first: NodeId | None = None) -> Log | None:
        """The newest log; None if that is still the one of the header `read`.

        `known`: any header of the scene, which names its keepers. `first`: who may know more than others. Unreachable if none of them
        answers, or the origin has lost it; Refused (16) if they show only older ones than were met.
        """
        if not known.participants:
            return await self._of_origin(known, read, first)
        shown = await self._shown(known, first)
        if read is not None and shown[0].public.proposed() == read.proposed():
            return None
        return await self._of_participants(shown)

    async def of(self, node: NodeId, read: SceneLogPublic) -> Log | None:
        """What one participant has; None if it is not newer than the header `read`. Unreachable, Refused, PeerFault or DamagedData if it shows none."""
        answer = await self._answer(address_of(node), Want.LOG, CLIENT_STATUS_S)
        if answer.private is None or answer.public.position <= read.position:
            return None
        return await self._opened(answer.public, answer.private)

    async def shown(self, known: SceneLogPublic, first: NodeId | None = None) -> list[Shown]:
        """How far some participants are, the furthest first."""
        return await self._shown(known, first)

    async def _of_origin(self, known: SceneLogPublic, read: SceneLogPublic | None, first: NodeId | None) -> Log | None:
        keeper = address_of(known.origin)
        if read is not None:
            answer = await self._ask_origin(keeper, Want.HEADER)
            # What was read before may be old by now, by other headers that were met: then a keeper that still shows its own lies, or lags.
            if answer is not None and answer.public == read and not self._forbids(answer.public):
                return None
        for _ in range(_OLD_LOGS_MAX):
            answer = await self._ask_origin(keeper, Want.LOG)
            if answer is not None and answer.public.participants and not self._forbids(answer.public):
                # It has let others decide since.
                return await self.newest(self._verified(answer.public), read, first)
            if answer is None or answer.private is None:
                raise self._no_log(keeper, "has lost it")
            # What was decided while the answer was on its way makes it old; and the next one is not.
            if not self._forbids(answer.public):
                return await self._opened(self._verified(answer.public), answer.private)
        raise self._no_log(keeper, "has an older one, or another one of the same position, than was met before")

    async def _ask_origin(self, keeper: str, want: Want) -> SceneLogAnswer | None:
        async def ask() -> RespondSceneLog:
            return await self._calls.ask(keeper, self._request(want), RespondSceneLog, priority=Priority.HIGH)

        try:
            return (await self._calls.patiently(ask, refresh=False)).answer
        except Unreachable as error:
            raise self._no_log(keeper, f"does not answer: {error.what}") from error

    async def _shown(self, known: SceneLogPublic, first: NodeId | None) -> list[Shown]:
        async def look(address: str) -> Shown:
            return Shown((await self._answer(address, Want.HEADER, CLIENT_STATUS_S)).public, address)

        async def once() -> list[Shown]:
            tries = [partial(look, address_of(node)) for node in self.in_order(known, first)]
            return await some_answers(
                tries,
                count=CLIENT_OPINIONS,
                next_after_s=CLIENT_NEXT_S,
                more_within_s=CLIENT_OPINION_S,
                at_a_time=CLIENT_ASKED_MAX,
            )

        try:
            shown = await self._calls.patiently(once, refresh=False)
        except Unreachable as error:
            raise self._none_answers(known, error) from error
        return sorted(shown, key=lambda one: -one.public.position)

    async def _of_participants(self, shown: Sequence[Shown]) -> Log:
        """The log of who is furthest, or of others that are as far. What does not verify is the fault of whoever shows it alone."""

        async def ask(address: str) -> Log:
            answer = await self._answer(address, Want.LOG, CLIENT_REQUEST_S)
            if answer.private is None or answer.public.position < shown[0].public.position:
                raise Refused(RejectReason.NOT_READY, "the node does not have the scene's log yet", where=address)
            try:
                return await self._opened(answer.public, answer.private)
            except DamagedData as problem:
                raise PeerFault(problem.what, where=f"{problem.where}, {address}", remedy=problem.remedy) from problem

        async def once() -> Log:
            # Those that are behind may have come further meanwhile.
            tries = [partial(ask, one.address) for one in shown]
            return await first_answer(tries, next_after_s=CLIENT_NEXT_S, at_a_time=CLIENT_ASKED_MAX, refusal_counts=False)

        try:
            # Who has just begun to take part knows the header before it has the log.
            return await self._calls.patiently(once, refresh=False)
        except Unreachable as error:
            raise self._none_answers(shown[0].public, error) from error

    async def _answer(self, address: str, want: Want, timeout_s: float) -> SceneLogAnswer:
        """What one participant shows, if it may count. Refused (16) otherwise, PeerFault if it does not verify."""
        reply = await self._calls.ask(address, self._request(want), RespondSceneLog, priority=Priority.HIGH, timeout_s=timeout_s)
        answer = reply.answer
        if answer is None:
            raise Refused(RejectReason.NOT_READY, "the node does not know the scene", where=address)
        try:
            verified = self._verified(answer.public)
        except DamagedData as problem:
            raise PeerFault(problem.what, where=f"{problem.where}, {address}", remedy=problem.remedy) from problem
        if verified != answer.public:
            raise Refused(RejectReason.NOT_READY, "the node shows an older log than was met before", where=address)
        return answer

    def _none_answers(self, known: SceneLogPublic, error: Unreachable) -> Unreachable:
        nodes = ", ".join(address_of(entry.member.node) for entry in known.participants)
        what = f"none of the nodes that decide the scene's log answers and has the newest: {error.what}"
        remedy = "start one of these: each has the log, which says what the scene consists of, its mode, and what became of changes"
        return Unreachable(what, where=f"scene {self._name}, {nodes}", remedy=remedy)

    def _no_log(self, keeper: str, why: str) -> Unreachable:
        remedy = "start that node: it alone has the log, which says what the scene consists of, its mode, and what became of changes"
        return Unreachable(f"the node that keeps the scene's log {why}", where=f"scene {self._name}, {keeper}", remedy=remedy)
