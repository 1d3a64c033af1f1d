"""A scene's log as a client reads and writes it (consensus.md §3, with one participant; specs/16-scene-log.md).

The node that the scene's headers name as origin keeps the log, sealed, and decides alone what its next position is. A
client with the scene's keys reads the newest log, makes the record that shall follow, and proposes header and sealed log
together. If somebody else was faster, it reads again and makes its record anew from what the log says now; the request id
stays, so that a proposal whose answer was lost is found instead of being made twice.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

from scenefold.base.errors import LocalFault, Refused, ScenefoldError, Unreachable
from scenefold.base.ids import SceneId, address_of
from scenefold.base.limits import CLIENT_LOG_TRIES_MAX
from scenefold.base.reasons import RejectReason
from scenefold.client.births import verify_header
from scenefold.client.calls import Calls
from scenefold.client.patience import Patience, is_passing
from scenefold.crypto import HEADER_DOMAIN, NONCE_BYTES, PublicKey, SigningKey
from scenefold.scene.log import OpenedLog, SceneLog, open_private, seal_private, sign_record
from scenefold.wire import (
    AcceptSceneProposal,
    Ballot,
    LogEntry,
    Phase,
    ProposalId,
    ProposeSceneLog,
    RejectSceneProposal,
    RequestSceneLog,
    RespondSceneLog,
    SceneLogAnswer,
    SceneLogPublic,
    SignedRecord,
    Want,
)
from scenefold.world import Priority

_REQUEST_ID_BYTES = 16
_TOO_LATE = frozenset({RejectReason.POSITION_TAKEN, RejectReason.POSITION_BEHIND})


@dataclass(frozen=True, slots=True)
class LogKeys:
    """What a scene's log opens and verifies with; `header_seed` None: it can only be read."""

    scene: SceneId
    genesis: bytes
    symmetric_key: bytes
    key_epoch: int
    header_key: PublicKey
    header_seed: bytes | None = None


@dataclass(frozen=True, slots=True)
class ReadLog:
    """The log at one position, and the header that vouches for it."""

    header: SceneLogPublic
    log: OpenedLog

    @property
    def state(self) -> SceneLog:
        return self.log.state


class LogAccess:
    """The log of one scene."""

    def __init__(self, calls: Calls, name: str, keys: LogKeys) -> None:
        self._calls = calls
        self._name = name
        self._keys = keys
        self._read: ReadLog | None = None
        """The log as it was read last; it is asked for again only when the keeper's header is another."""

    async def header(self, have: int = 0) -> SceneLogPublic | None:
        """The newest header that a node knows, at position `have` or later if any has that; None if the scene is unknown."""
        reply = await self._calls.ask_any(self._request(Want.HEADER, have), RespondSceneLog)
        return None if reply.answer is None else self._verified(reply.answer.public)

    async def newest(self, header: SceneLogPublic | None = None) -> ReadLog:
        """The log as its keeper has it now. `header`: any header of the scene, for it names the keeper.

        Unreachable if the keeper does not answer, or has lost the log.
        """
        header = header or (await self.header() if self._read is None else self._read.header)
        if header is None:
            raise LocalFault("the cluster does not know this scene", where=f"scene {self._name}")
        keeper = address_of(header.origin)
        if self._read is not None:
            answer = await self._ask_keeper(keeper, Want.HEADER)
            if answer is not None and answer.public == self._read.header:
                return self._read
        answer = await self._ask_keeper(keeper, Want.LOG)
        if answer is None or answer.private is None:
            raise self._no_log(keeper, "has lost it")
        public = self._verified(answer.public)
        self._read = await self._calls.world.workers.run("crypto", self._opened, public, answer.private, self._read)
        return self._read

    async def _ask_keeper(self, keeper: str, want: Want) -> SceneLogAnswer | None:
        async def ask() -> RespondSceneLog:
            return await self._calls.ask(keeper, self._request(want, 0), RespondSceneLog, priority=Priority.HIGH)

        try:
            return (await self._calls.patiently(ask, refresh=False)).answer
        except Unreachable as error:
            raise self._no_log(keeper, f"does not answer: {error.what}") from error

    async def propose(self, entry_of: Callable[[SceneLog], LogEntry]) -> ReadLog:
        """Bring an entry into the log; gives the log with it. `entry_of` makes it from the log as it is, each time anew.

        LocalFault if the entry does not fit, or this profile may not sign; Unreachable with words if it is not known
        whether it went in.
        """
        if self._keys.header_seed is None:
            raise LocalFault("these keys can only read the scene", where=f"scene {self._name}", remedy="use the profile that made it")
        key = SigningKey.from_seed(self._keys.header_seed)
        request_id = self._calls.world.entropy.token(_REQUEST_ID_BYTES)
        lost: ScenefoldError | None = None
        patience = Patience()
        for attempt in range(CLIENT_LOG_TRIES_MAX):
            if attempt:
                patience.bears(None)
                await self._calls.pause(patience)
            try:
                before = await self.newest()
            except Unreachable as error:
                if lost is None:
                    raise
                remedy = "see with `scenectl space list` whether it was made, before you repeat it"
                raise Unreachable("the answer to a change was lost", where=f"scene {self._name}: {error.what}", remedy=remedy) from lost
            if request_id in before.state.requests:
                return before
            after = self._followed(before, entry_of(before.state), request_id, key)
            try:
                if await self._offer(after):
                    return after
            except Unreachable as error:
                lost = error
        raise Refused(RejectReason.BUSY, "others change the scene all the time", where=f"scene {self._name}", remedy="try again")

    async def announce(self, header: SceneLogPublic, records: tuple[SignedRecord, ...]) -> None:
        """Propose a first header with its record. Refused with the reason of the node that decides."""
        await self._propose(header, records, _refusal)

    async def _offer(self, log: ReadLog) -> bool:
        """Whether the keeper took it; False if another one was first, or it is busy."""
        reasons: list[RejectReason] = []

        def note(reason: RejectReason, name: str) -> None:
            if reason not in _TOO_LATE and not is_passing(reason):
                _refusal(reason, name)
            reasons.append(reason)

        await self._propose(log.header, log.log.records, note)
        return not reasons

    async def _propose(
        self, header: SceneLogPublic, records: tuple[SignedRecord, ...], rejected: Callable[[RejectReason, str], None]
    ) -> None:
        keys, nonce = self._keys, self._calls.world.entropy.token(NONCE_BYTES)
        sealing = partial(seal_private, genesis=keys.genesis, symmetric_key=keys.symmetric_key, key_epoch=keys.key_epoch, nonce=nonce)
        private = await self._calls.world.workers.run("crypto", sealing, records)
        packet = ProposeSceneLog(
            genesis=self._keys.genesis,
            proposal=ProposalId(header.position, Ballot(1, header.origin), Phase.ACCEPT),
            route=(header.origin,),
            nodes=(),
            highest=None,
            takeover=False,
            public=header,
            private=private,
            mac_epoch=0,
            mac=b"",
        )
        reply = await self._calls.ask_any(packet, (AcceptSceneProposal, RejectSceneProposal), first=header.origin)
        if isinstance(reply, RejectSceneProposal):
            rejected(reply.reason, self._name)

    def _followed(self, before: ReadLog, entry: LogEntry, request_id: bytes, key: SigningKey) -> ReadLog:
        """The log with one more entry, its header signed."""
        record = before.state.next_record(entry, request_id, before.header.origin)
        try:
            # Encoding first: its complaints about single numbers are plainer than what follows from them.
            signed = sign_record(record, key)
            state = before.state.apply(record)
        except Refused as refusal:
            raise LocalFault(refusal.what, where=f"scene {self._name}", remedy="`scenectl space list` shows what there is") from refusal
        header = replace(
            before.header,
            position=state.position,
            write_floor=max(state.write_floor, before.header.write_floor),
            mode=state.mode,
            spaces=state.public_spaces(),
        )
        header = replace(header, signature=key.sign(HEADER_DOMAIN, header.signable()))
        return ReadLog(header, OpenedLog(state, (*before.log.records, signed)))

    def _opened(self, header: SceneLogPublic, private: bytes, before: ReadLog | None) -> ReadLog:
        keys = self._keys
        log = open_private(
            private,
            genesis=keys.genesis,
            position=header.position,
            symmetric_key=keys.symmetric_key,
            header_key=keys.header_key,
            known=None if before is None else before.log,
        )
        return ReadLog(header, log)

    def _verified(self, header: SceneLogPublic) -> SceneLogPublic:
        verify_header(header, self._keys.scene, self._keys.genesis, self._keys.header_key)
        return header

    def _request(self, want: Want, have: int) -> RequestSceneLog:
        nonce = int.from_bytes(self._calls.world.entropy.token(8), "big")
        return RequestSceneLog(self._keys.scene, self._keys.genesis, have, nonce, want)

    def _no_log(self, keeper: str, why: str) -> Unreachable:
        remedy = "start that node: its spaces and transforms are read from there"
        return Unreachable(f"the node that keeps the scene's log {why}", where=f"scene {self._name}, {keeper}", remedy=remedy)


def _refusal(reason: RejectReason, name: str) -> None:
    words = reason.name.lower().replace("_", " ")
    raise Refused(reason, f"the cluster refused the scene: {words}", where=f"scene {name}")
