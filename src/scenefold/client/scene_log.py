"""A scene's log as a client reads and writes it (consensus.md §3; specs/16-scene-log.md).

Those who decide it keep it, sealed: the node that the scene's headers name as origin, or its participants (log_keepers.py). A
client with the scene's keys reads the newest log, makes the record that shall follow, and proposes header and sealed log
together (offering.py). If somebody else was faster, it reads again and makes its record anew from what the log says now; the request id
stays, so that a proposal whose answer was lost is found instead of being made twice. What is not found may still be on its
way, until its position is taken: till then nobody is told that it was refused (doubt.py), and the very same header is proposed again.
Whoever is told that nobody knows may repeat the change in any process, under the same request (requests.py, repeating.py).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import trio

from scenefold.base.errors import DamagedData, LocalFault, NotReached, PeerFault, Refused, ScenefoldError, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.base.limits import CLIENT_AUTHOR_S, CLIENT_LOG_TRIES_MAX
from scenefold.base.reasons import RejectReason
from scenefold.client.doubt import Doubt
from scenefold.client.log_reading import LogReading, ReadLog
from scenefold.client.offering import Rejected, offered, offered_to
from scenefold.client.offers import proposal_of, refusal_of
from scenefold.client.pace import Pace
from scenefold.client.patience import Patience, is_passing
from scenefold.client.repeating import check_same, check_told_of, is_told_of, state_before
from scenefold.client.requests import Again, Change, InDoubt, Request, change_of, how_to_find_out
from scenefold.crypto import MemberSecrets, SigningKey
from scenefold.scene.log import Draft, Followed, SceneLog, follow, keys_with_log
from scenefold.wire import LogEntry, ProposeSceneLog, SceneLogPublic

__all__ = ["LogAccess", "ReadLog", "Standing"]

_REQUEST_ID_BYTES = 16
_AT_END_S = 10.0
"""For somebody to show the log of a scene that was ended: who has it still does so at once, and who has let go of it never will."""
_TOO_LATE = frozenset({RejectReason.POSITION_TAKEN, RejectReason.POSITION_BEHIND})
_NOT_LOOKED_AT = frozenset({RejectReason.NOT_AUTHORISED, RejectReason.BUSY, RejectReason.KEY_REVOKED})
"""Faults that say that a proposal was not looked at. Others may be those of a relay behind which it was decided."""


@dataclass(frozen=True, slots=True)
class Standing:
    """What became of a request: `position` if it is in the log. Else `is_over` if it never will be; if not, it may still come.

    `known`: the newest position that was seen.
    """

    position: int | None
    is_over: bool
    known: int

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        outcome = "committed" if self.position is not None else "never" if self.is_over else "open"
        return {"outcome": outcome, "position": self.position, "known_position": self.known}


def _told(read: ReadLog, request_id: bytes, offered_at: int) -> Standing | None:
    """What a log says of a request; None if it may still come, or be there without being told of."""
    found, known = read.state.requests.get(request_id), read.header.position
    if found is None and not (offered_at and known >= offered_at and is_told_of(read.state, offered_at)):
        return None
    return Standing(found, True, known)


class _ChangeDoubt(Doubt):
    """Of offers of one change, by their positions."""

    def __init__(self, name: str, request_id: bytes) -> None:
        def remedy(position: int) -> str:
            return how_to_find_out(name, Request(request_id, position))

        super().__init__("a change", lambda _: f"scene {name}", remedy, is_open_after=_may_be_decided)
        self._request_id = request_id

    def _unknown(self, number: int, what: str, *, where: str, remedy: str) -> Unreachable:
        return InDoubt(what, where=where, remedy=remedy, request=Request(self._request_id, number))


def _may_be_decided(reason: RejectReason) -> bool:
    """After a Fault for this reason."""
    return reason not in _NOT_LOOKED_AT


class _VoterAway(NotReached):
    """The one node that decides where scenes begin."""


def _voter_is_away(voter: NodeId) -> _VoterAway:
    what = "no scene can be made while the cluster's first voter is away, and it does not answer: nothing was made"
    return _VoterAway(
        what, where=address_of(voter), remedy="start that node, and create the scene again; the scenes that there are can be used"
    )


class LogAccess(LogReading):
    """What is read, and what is proposed."""

    async def propose(self, entry_of: Callable[[SceneLog], LogEntry], *, again: Again = None, forced: bool = False) -> ReadLog:
        """Bring an entry into the log; gives the log with it. `entry_of` makes it from the log as it is, each time anew, and of one log the same one.

        `again`: the request by which it was proposed before, and may be in the log, or on its way: it will be there once; or a `Change`, which is told
        of the request, and of the position, also if this is cancelled. `forced`: it is a change of
        the mode, and goes in whomever it does not suit. LocalFault if the entry does not fit, or we are no owner, or the log has another entry
        under that request; Refused if it did not go in, or (9) the mode forbids it, or (2) the log has forgotten such an old request; InDoubt if nobody knows.
        """
        change, secrets = change_of(again), await self.owner()
        before = change.request
        request = Request(self._calls.world.entropy.token(_REQUEST_ID_BYTES)) if before is None else before
        doubt = _ChangeDoubt(self._name, request.id)
        if request.offered_at:
            # What was offered then may come, whatever is answered now.
            doubt.note([request.offered_at])
        try:
            with doubt.no_refusal(nor_silence=True):
                return await self._proposed(entry_of, change, request, secrets.signing, doubt, forced=forced)
        except BaseException:
            if change.position is None and doubt.latest is not None:
                # Who is cancelled raises no error that could say so.
                change.request = Request(request.id, doubt.latest)
            raise

    async def owner(self) -> MemberSecrets:
        """What we sign changes with; LocalFault if we are no owner of the scene."""
        if self.keys.header_seed is None:
            await self.header()  # it may have been given since
        if self.keys.header_seed is None or self._secrets is None:
            raise LocalFault("only an owner of the scene may change this", where=f"scene {self._name}", remedy="ask one of them")
        return self._secrets

    async def _proposed(
        self,
        entry_of: Callable[[SceneLog], LogEntry],
        change: Change,
        request: Request,
        author: SigningKey,
        doubt: Doubt,
        *,
        forced: bool,
    ) -> ReadLog:
        pace = Pace(self._calls)
        until = trio.current_time() + CLIENT_AUTHOR_S
        draft: tuple[ReadLog, Followed] | None = None
        problem: Unreachable | PeerFault | Refused | None = None
        first: NodeId | None = None
        before: ReadLog | None = None
        is_new = change.request is None
        if is_new and self._was_alone:
            draft = await self._gone_on(entry_of, request.id, author)
        for attempt in range(CLIENT_LOG_TRIES_MAX + 1):
            await pace.pause(is_late=first is not None and before is not None and bool(before.header.participants))
            before = draft[0] if draft is not None and attempt == 0 else await self.newer(first)
            if request.id in before.state.requests:
                doubt.settle_all()
                found = before if is_new else await self._found(before, entry_of, request)
                change.stands(request.id, found.state.requests[request.id])
                return found
            if draft is not None and not before.state.tells_of(draft[1].header.position):
                # So much was decided since that the log would not know the request any more.
                break
            if draft is not None and first is not None and before.header.position < draft[1].header.position:
                # Nobody shows what it says that there is.
                pace.failures += 1
            if before.header.position >= max(request.offered_at, 0 if draft is None else draft[1].header.position):
                # Whatever was offered so far has its position taken by something else, and never goes in.
                doubt.settle_all()
                problem = None
            if draft is None:
                check_told_of(before.state, request, self._name)
            is_late = bool(before.header.participants) and trio.current_time() >= until
            if attempt == CLIENT_LOG_TRIES_MAX or is_late:
                break
            draft = await self._drafted(draft, before, entry_of, request.id, author)
            after = draft[1]
            try:
                # Who says that others were faster is asked first again: there we stand in line.
                packet = proposal_of(after.header, after.private, forced=forced)
                outcome = await self._offer(packet, before.header, doubt, pace.failures)
                if isinstance(outcome, SceneLogPublic):
                    change.stands(request.id, outcome.position)
                    self._take(outcome, keys_with_log(after.keys, after.log.state))
                    await self._memory.keep()
                    self._read = ReadLog(outcome, after.log)
                    self._was_alone = attempt == 0
                    return self._read
                self._was_alone = False
                first = outcome.by if outcome.reason in _TOO_LATE else None
                problem = None if outcome.reason in _TOO_LATE else self._problem(outcome, before.header, after.header)
            except (Unreachable, PeerFault, Refused) as error:
                problem, first = error, None
            # While there is doubt, what the log says next is better than what this answer says.
            if isinstance(problem, Refused) and not is_passing(problem.reason) and after.header.position not in doubt:
                raise problem
        busy = Refused(RejectReason.BUSY, "others change the scene all the time", where=f"scene {self._name}", remedy="try again")
        raise problem or busy

    async def _found(self, read: ReadLog, entry_of: Callable[[SceneLog], LogEntry], request: Request) -> ReadLog:
        """A log that has the request of somebody who repeats a change; errors as of `check_same`."""
        then = await self._calls.world.workers.run("crypto", state_before, read.log, read.state.requests[request.id])
        check_same(read, then, request, entry_of, self._name)
        return read

    async def _drafted(
        self,
        draft: tuple[ReadLog, Followed] | None,
        before: ReadLog,
        entry_of: Callable[[SceneLog], LogEntry],
        request_id: bytes,
        author: SigningKey,
    ) -> tuple[ReadLog, Followed]:
        """The next position behind `before`: the very same draft while that is the newest header."""
        if draft is not None and draft[0].header.proposed() == before.header.proposed():
            return draft
        made = self._following(before, entry_of(before.state), request_id, author)
        return before, await self._calls.world.workers.run("crypto", made.sealed)

    async def _gone_on(
        self, entry_of: Callable[[SceneLog], LogEntry], request_id: bytes, author: SigningKey
    ) -> tuple[ReadLog, Followed] | None:
        """The next position from the log as we left it, if that is what we met last and the entry fits there; who decides says if others went on."""
        before = self._read
        if before is None or not before.header.participants or before.header != self._followed:
            return None
        try:
            made = self._following(before, entry_of(before.state), request_id, author)
        except ScenefoldError:
            # It may fit by now.
            return None
        return before, await self._calls.world.workers.run("crypto", made.sealed)

    async def standing(self, request_id: bytes, offered_at: int = 0) -> Standing:
        """What became of a request, in any process: those who decide bring to its end what was begun, and then the log is looked at.

        `offered_at`: the highest position that it was proposed for; 0 if that is not known, and then "never" cannot be told. Unreachable
        if nobody can tell now: no refusal says anything of the request.
        """
        try:
            return await self._standing(request_id, offered_at)
        except Refused as refusal:
            what = f"nobody can tell now what became of the change: {refusal.what}"
            raise Unreachable(what, where=refusal.where, remedy=refusal.remedy or "ask again in a while") from refusal

    async def _standing(self, request_id: bytes, offered_at: int) -> Standing:
        patience, doubt = Patience(), self._doubt("nothing", lambda _: "")
        until = trio.current_time() + CLIENT_AUTHOR_S
        first: NodeId | None = None
        for attempt in itertools.count():
            try:
                read = await self.newest(first=first)
            except Refused:
                if (ended := self._end) is None:
                    raise
                return await self._standing_at_end(ended, request_id, offered_at)
            known = read.header.position
            if (told := _told(read, request_id, offered_at)) is not None:
                return told
            if not read.header.participants:
                return Standing(None, False, known)
            # What is decided already is proposed again: an answer says that a majority knows of nothing behind it.
            outcome = await self._offer(proposal_of(read.header.proposed(), b""), read.header, doubt, attempt)
            if isinstance(outcome, SceneLogPublic):
                return Standing(None, False, known)
            reason, first = (RejectReason.BUSY if outcome.reason in _TOO_LATE else outcome.reason), outcome.by
            problem = self._refusal(outcome._replace(reason=reason), read.header, is_question=True)
            if not patience.bears(problem) or trio.current_time() >= until:
                raise problem
            await self._calls.pause(patience)
        raise AssertionError("whoever asks loses patience")

    async def _standing_at_end(self, ended: SceneLogPublic, request_id: bytes, offered_at: int) -> Standing:
        """Of a request of a scene that was ended: the header tells of the newest one, and the log of others, while somebody has it still."""
        if ended.request == request_id:
            return Standing(ended.position, True, ended.position)
        if ended.request and offered_at == ended.position:
            # That is another change's, and whatever was offered before was known not to come by then.
            return Standing(None, True, ended.position)
        with suppress(Unreachable, Refused, PeerFault, DamagedData), trio.move_on_after(_AT_END_S):
            told = _told(await self.at_end(ended), request_id, offered_at)
            if told is not None:
                return told
        what = f"the scene was ended at position {ended.position} of its log, and nobody shows the log any more: whether it has the change nobody can tell"
        raise Unreachable(what, where=f"scene {self._name}", remedy="nothing can be changed in it any more, so there is nothing to repeat")

    async def announce(self, header: SceneLogPublic, private: bytes) -> SceneLogPublic:
        """Propose a first header with its sealed log; again is the same. Gives the header as it was decided.

        Refused with the reason of the node that decides; Unreachable if that is away, with words if it is not known whether the scene is made.
        """
        remedy = "create it again: its keys are kept, and if it is there you are told so"
        doubt = self._doubt("the creation of the scene", lambda _: remedy)
        packet = proposal_of(header, private)

        async def offer() -> SceneLogPublic:
            outcome = await offered(self._calls, packet, doubt)
            if isinstance(outcome, SceneLogPublic):
                return outcome
            if outcome.reason is RejectReason.PEER_MISSED:
                raise _voter_is_away(outcome.by)
            raise refusal_of(*outcome, name=self._name)

        with doubt.no_refusal():
            try:
                return await self._calls.of_any(offer)
            except Unreachable as problem:
                away = problem.__cause__
                if not isinstance(away, _VoterAway):
                    raise
                if header.position in doubt:
                    raise Refused(RejectReason.PEER_MISSED, away.what, where=away.where, remedy=away.remedy) from away
                raise away from None

    def _problem(self, rejected: Rejected, before: SceneLogPublic, after: SceneLogPublic) -> NotReached | Refused:
        """Why a change was not decided."""
        if rejected.reason is RejectReason.PEER_MISSED and not before.participants:
            # Whoever hands it on could not reach the origin. That is no word of the origin's, and it may be back in a moment.
            where = f"scene {self._name}, {address_of(before.origin)}"
            what = "the node that decides the scene's log does not answer: nothing was changed"
            return NotReached(what, where=where, remedy="start that node, and repeat it")
        return self._refusal(rejected, before, after)

    def _refusal(
        self, rejected: Rejected, before: SceneLogPublic, after: SceneLogPublic | None = None, *, is_question: bool = False
    ) -> Refused:
        nodes = [entry.member.node for entry in before.participants]
        silent = [node for node in nodes if self._calls.is_silent(node, within_s=CLIENT_AUTHOR_S)]
        return refusal_of(*rejected, name=self._name, before=before, after=after, silent=silent, is_question=is_question)

    def _doubt(self, what: str, remedy: Callable[[int], str]) -> Doubt:
        """Of offers, by their positions."""
        return Doubt(what, lambda _: f"scene {self._name}", remedy, is_open_after=_may_be_decided)

    async def _offer(self, packet: ProposeSceneLog, before: SceneLogPublic, doubt: Doubt, attempt: int) -> SceneLogPublic | Rejected:
        """One round of asking those who decide what follows `before`. Who was asked first last time, and could not, is asked last this time."""
        nodes = self.keepers.to_propose(before)
        try:
            if not nodes:
                return await offered(self._calls, packet, doubt)
            turn = attempt % len(nodes)
            return await offered_to(self._calls, nodes[turn:] + nodes[:turn], packet, doubt)
        except ScenefoldError:
            raise
        except BaseException:
            # Cancelled, perhaps in a group: the answer of one that has decided it may have come in this very moment.
            doubt.note([packet.public.position])
            raise

    def _following(self, before: ReadLog, entry: LogEntry, request_id: bytes, author: SigningKey) -> Draft:
        """The log with one more entry."""
        record = before.state.next_record(entry, request_id, before.header.origin)
        try:
            # Encoding first: its complaints about single numbers are plainer than what follows from them.
            record.encode()
            return follow(before.header, before.log, record, self.keys, author, self._calls.world.entropy.token)
        except Refused as refusal:
            if refusal.reason is RejectReason.MODE_FORBIDS:
                raise Refused(refusal.reason, refusal.what, where=f"scene {self._name}", remedy=refusal.remedy) from refusal
            remedy = refusal.remedy or "`scenectl space list` and `scenectl scene access` show what there is"
            raise LocalFault(refusal.what, where=f"scene {self._name}", remedy=remedy) from refusal
