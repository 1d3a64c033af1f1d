"""A scene's log as a client reads and writes it (consensus.md §3, with one participant; specs/16-scene-log.md).

The node that the scene's headers name as origin keeps the log, sealed, and decides alone what its next position is. A
client with the scene's keys reads the newest log, makes the record that shall follow, and proposes header and sealed log
together. If somebody else was faster, it reads again and makes its record anew from what the log says now; the request id
stays, so that a proposal whose answer was lost is found instead of being made twice. What is not found may still be on its
way, until its position is taken: till then nobody is told that it was refused (doubt.py).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from scenefold.base.errors import LocalFault, PeerFault, Refused, Unreachable
from scenefold.base.ids import address_of
from scenefold.base.limits import CLIENT_LOG_TRIES_MAX
from scenefold.base.reasons import RejectReason
from scenefold.client.calls import Calls
from scenefold.client.doubt import Doubt
from scenefold.client.offers import as_decided, check_answer, proposal_of, refusal_of
from scenefold.client.patience import Patience, is_passing
from scenefold.client.scene_memory import Met, SceneMemory
from scenefold.client.sealing import key_withheld
from scenefold.crypto import MemberSecrets, PublicKey, SigningKey
from scenefold.scene.log import (
    Draft,
    OpenedLog,
    SceneKeys,
    SceneLog,
    check_log,
    check_told,
    follow,
    keys_after,
    keys_with_log,
    open_private,
)
from scenefold.wire import (
    AcceptSceneProposal,
    LogEntry,
    ProposeSceneLog,
    RejectSceneProposal,
    RequestSceneLog,
    RespondSceneLog,
    SceneLogAnswer,
    SceneLogPublic,
    Want,
)
from scenefold.world import Priority

_REQUEST_ID_BYTES = 16
_OLD_LOGS_MAX = 3
_TOO_LATE = frozenset({RejectReason.POSITION_TAKEN, RejectReason.POSITION_BEHIND})
_NOT_LOOKED_AT = frozenset({RejectReason.NOT_AUTHORISED, RejectReason.BUSY, RejectReason.KEY_REVOKED})
"""Faults that say that a proposal was not looked at. Others may be those of a relay behind which it was decided."""


@dataclass(frozen=True, slots=True)
class ReadLog:
    """The log at one position, and the header that vouches for it."""

    header: SceneLogPublic
    log: OpenedLog

    @property
    def state(self) -> SceneLog:
        return self.log.state


class LogAccess:
    """The log of one scene. `keys`: what we have of the scene's, by all headers and logs that were met."""

    def __init__(self, calls: Calls, keys: SceneKeys, secrets: MemberSecrets | None = None, memory: SceneMemory | None = None) -> None:
        """`secrets`: open what newer headers hold for us, and sign what we grant; None: nothing does.

        `memory`: how far the scene was when it was met before; None: that is not known, nor kept.
        """
        self._calls = calls
        self._name = keys.name
        self.keys = keys
        self._secrets = secrets
        self._memory = memory or SceneMemory(Met(0, 0))
        self._followed: SceneLogPublic | None = None
        """The header that `keys` were taken from last."""
        self._read: ReadLog | None = None
        """The log as it was read last; it is asked for again only when the keeper's header is another."""

    async def header(self, have: int = 0) -> SceneLogPublic | None:
        """The newest header that some nodes know, at position `have` or later if any has that; None if the scene is unknown.

        Who does not know it once we were shown one has lost it, or never heard of it: others are asked, then Refused (16).
        None that is older than one that was met before, whoever shows it: its key may be one that somebody has whose access was revoked.
        """

        def judged(reply: RespondSceneLog) -> SceneLogPublic | None:
            if reply.answer is not None:
                return self._verified(reply.answer.public)
            if self._followed is not None:
                remedy = "start all nodes of the cluster; one of them had it"
                raise Refused(RejectReason.NOT_READY, "the cluster does not know the scene", where=f"scene {self._name}", remedy=remedy)
            return None

        request = self._request(Want.HEADER, max(have, self._memory.met.position))
        origin = None if self._followed is None else self._followed.origin
        shown = await self._calls.opinions(request, RespondSceneLog, judged, first=origin)
        await self._memory.keep()
        return max((header for header in shown if header is not None), key=lambda header: header.position, default=None)

    async def newest(self, header: SceneLogPublic | None = None) -> ReadLog:
        """The log as its keeper has it now. `header`: any header of the scene, for it names the keeper.

        Unreachable if the keeper does not answer, or has lost the log; Refused (17) if we have no key to it any more.
        """
        header = header or (await self.header() if self._read is None else self._read.header)
        if header is None:
            raise LocalFault("the cluster does not know this scene", where=f"scene {self._name}")
        keeper = address_of(header.origin)
        if self._read is not None:
            answer = await self._ask_keeper(keeper, Want.HEADER)
            # What was read before may be old by now, by other headers that were met: then a keeper that still shows its own lies, or lags.
            if answer is not None and answer.public == self._read.header and not self._memory.forbids(answer.public):
                return self._read
        for _ in range(_OLD_LOGS_MAX):
            answer = await self._ask_keeper(keeper, Want.LOG)
            if answer is None or answer.private is None:
                raise self._no_log(keeper, "has lost it")
            # What was decided while the answer was on its way makes it old; and the next one is not.
            if not self._memory.forbids(answer.public):
                break
        else:
            raise self._no_log(keeper, "has an older one, or another one of the same position, than was met before")
        public = self._verified(answer.public)
        await self._memory.keep()
        key = self.keys.epochs.get(public.key_epoch)
        if key is None:
            raise key_withheld(f"scene {self._name}")
        opening = partial(_opened, public, answer.private, key, self.keys.header_key, self._read)
        self._read = read = await self._calls.world.workers.run("crypto", opening)
        self.keys = keys_with_log(self.keys, read.state)
        return read

    async def _ask_keeper(self, keeper: str, want: Want) -> SceneLogAnswer | None:
        async def ask() -> RespondSceneLog:
            return await self._calls.ask(keeper, self._request(want, 0), RespondSceneLog, priority=Priority.HIGH)

        try:
            return (await self._calls.patiently(ask, refresh=False)).answer
        except Unreachable as error:
            raise self._no_log(keeper, f"does not answer: {error.what}") from error

    async def propose(self, entry_of: Callable[[SceneLog], LogEntry]) -> ReadLog:
        """Bring an entry into the log; gives the log with it. `entry_of` makes it from the log as it is, each time anew.

        LocalFault if the entry does not fit, or we are no owner; Refused if it did not go in; Unreachable, with words, if nobody knows.
        """
        secrets = await self.owner()
        to_do = "see with `scenectl space list` or `scenectl scene access` whether it was made, before you repeat it"
        doubt = self._doubt("a change", to_do)
        with doubt.no_refusal(nor_silence=True):
            return await self._proposed(entry_of, secrets.signing, doubt)

    async def owner(self) -> MemberSecrets:
        """What we sign changes with; LocalFault if we are no owner of the scene."""
        if self.keys.header_seed is None:
            await self.header()  # it may have been given since
        if self.keys.header_seed is None or self._secrets is None:
            raise LocalFault("only an owner of the scene may change this", where=f"scene {self._name}", remedy="ask one of them")
        return self._secrets

    async def _proposed(self, entry_of: Callable[[SceneLog], LogEntry], author: SigningKey, doubt: Doubt) -> ReadLog:
        request_id = self._calls.world.entropy.token(_REQUEST_ID_BYTES)
        patience = Patience()
        offered = 0
        problem: Unreachable | PeerFault | Refused | None = None
        for attempt in range(CLIENT_LOG_TRIES_MAX + 1):
            if attempt:
                patience.bears(None)
                await self._calls.pause(patience)
            before = await self.newest()
            if request_id in before.state.requests:
                return before
            if before.header.position >= offered:
                # Whatever was offered so far has its position taken by something else, and never goes in.
                doubt.settle_all()
                problem = None
            if attempt == CLIENT_LOG_TRIES_MAX:
                break
            draft = self._following(before, entry_of(before.state), request_id, author)
            after = await self._calls.world.workers.run("crypto", draft.sealed)
            offered = after.header.position
            try:
                outcome = await self._offer(proposal_of(after.header, after.private), doubt)
                if isinstance(outcome, SceneLogPublic):
                    self._take(outcome, keys_with_log(after.keys, after.log.state))
                    await self._memory.keep()
                    return ReadLog(outcome, after.log)
                problem = None if outcome in _TOO_LATE else refusal_of(outcome, self._name)
            except (Unreachable, PeerFault, Refused) as error:
                problem = error
            # While there is doubt, what the log says next is better than what this answer says.
            if isinstance(problem, Refused) and not is_passing(problem.reason) and offered not in doubt:
                raise problem
        busy = Refused(RejectReason.BUSY, "others change the scene all the time", where=f"scene {self._name}", remedy="try again")
        raise problem or busy

    async def announce(self, header: SceneLogPublic, private: bytes) -> SceneLogPublic:
        """Propose a first header with its sealed log; again is the same. Gives the header as it was decided.

        Refused with the reason of the node that decides; Unreachable, with words if it is not known whether the scene is made.
        """
        remedy = "create it again: its keys are kept, and if it is there you are told so"
        doubt = self._doubt("the creation of the scene", remedy)
        packet = proposal_of(header, private)

        async def offer() -> SceneLogPublic:
            outcome = await self._offer(packet, doubt)
            if isinstance(outcome, SceneLogPublic):
                return outcome
            raise refusal_of(outcome, self._name)

        with doubt.no_refusal():
            return await self._calls.of_any(offer)

    def _doubt(self, what: str, remedy: str) -> Doubt:
        """Of offers, by their positions."""
        return Doubt(what, lambda _: f"scene {self._name}", remedy, is_open_after=lambda reason: reason not in _NOT_LOOKED_AT)

    async def _offer(self, packet: ProposeSceneLog, doubt: Doubt) -> SceneLogPublic | RejectReason:
        """One round of asking: the header as it was decided, or the reason of the node that decides, or of one that cannot ask it."""
        offered = [packet.public.position]
        answers = AcceptSceneProposal, RejectSceneProposal
        reply: AcceptSceneProposal | RejectSceneProposal = await self._calls.ask_around(
            packet,
            answers,
            first=packet.public.origin,
            around=lambda: doubt.trying(offered),
            # Whatever comes out of this round has passed it.
            judged=partial(check_answer, packet),
        )
        if isinstance(reply, AcceptSceneProposal):
            return as_decided(packet, reply)
        if reply.reason == RejectReason.NOT_READY:
            doubt.note(offered)
        return reply.reason

    def _following(self, before: ReadLog, entry: LogEntry, request_id: bytes, author: SigningKey) -> Draft:
        """The log with one more entry."""
        record = before.state.next_record(entry, request_id, before.header.origin)
        try:
            # Encoding first: its complaints about single numbers are plainer than what follows from them.
            record.encode()
            return follow(before.header, before.log, record, self.keys, author, self._calls.world.entropy.token)
        except Refused as refusal:
            remedy = refusal.remedy or "`scenectl space list` and `scenectl scene access` show what there is"
            raise LocalFault(refusal.what, where=f"scene {self._name}", remedy=remedy) from refusal

    def _verified(self, header: SceneLogPublic) -> SceneLogPublic:
        """The header, if it is the scene's; what it holds for us is taken. For one that is older than what we met, or another one of its position, that one; Refused (16) if only its position is known."""
        if header == self._followed:
            return header
        forbidden, contradicts = self._memory.forbids(header), self._memory.contradicts(header)
        if not forbidden or contradicts:
            keys = keys_after(header, self.keys, None if self._secrets is None else self._secrets.sealing)
            if not forbidden:
                self._take(header, keys)
                return header
            self._memory.report(header, self._name)
        if self._followed is None:
            raise self._memory.refusal(self._name)
        return self._followed

    def _take(self, header: SceneLogPublic, keys: SceneKeys) -> None:
        if not self._memory.forbids(header):
            self._followed, self.keys = header, keys
            self._memory.meets(header, None if self._secrets is None else self._secrets.sealing)

    def _request(self, want: Want, have: int) -> RequestSceneLog:
        nonce = int.from_bytes(self._calls.world.entropy.token(8), "big")
        return RequestSceneLog(self.keys.scene_id, self.keys.genesis, have, nonce, want)

    def _no_log(self, keeper: str, why: str) -> Unreachable:
        remedy = "start that node: its spaces and transforms are read from there"
        return Unreachable(f"the node that keeps the scene's log {why}", where=f"scene {self._name}, {keeper}", remedy=remedy)


def _opened(header: SceneLogPublic, private: bytes, key: bytes, header_key: PublicKey, before: ReadLog | None) -> ReadLog:
    check_log(header, private)
    keyed_at = header.succession[-1].position if header.succession else 1
    log = open_private(
        private,
        genesis=header.genesis,
        position=header.position,
        symmetric_key=key,
        header_key=header_key,
        header_keyed_at=keyed_at,
        known=None if before is None else before.log,
    )
    check_told(header, log.state)
    return ReadLog(header, log)
