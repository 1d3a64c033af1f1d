"""A scene's log as whoever has its keys reads it (specs/16-scene-log.md, Bytes and Following).

The newest header says who keeps the log (log_keepers.py); what is shown is verified, held against what was met before, and remembered.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import partial

from scenefold.base.errors import DamagedData, LocalFault, PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.client.calls import Calls
from scenefold.client.log_keepers import LogKeepers
from scenefold.client.scene_memory import Met, SceneMemory
from scenefold.client.sealing import key_withheld, scene_ended
from scenefold.crypto import MemberSecrets, PublicKey
from scenefold.scene.log import OpenedLog, SceneKeys, SceneLog, check_log, check_told, keys_after, keys_with_log, open_private
from scenefold.wire import RequestSceneLog, RespondSceneLog, SceneLogPublic, SceneMode, Want


@dataclass(frozen=True, slots=True)
class ReadLog:
    """The log at one position, and the header that vouches for it."""

    header: SceneLogPublic
    log: OpenedLog

    @property
    def state(self) -> SceneLog:
        return self.log.state


class LogReading:
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
        self._was_alone = False
        """Our last change went in at once, behind what we had read."""
        self.keepers: LogKeepers[ReadLog] = LogKeepers(
            calls, self._name, partial(self.request, have=0), self._memory.forbids, self._verified, self._opened
        )

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

        request = self.request(Want.HEADER, max(have, self._memory.met.position))
        origin = None if self._followed is None else self._followed.origin
        shown = await self._calls.opinions(request, RespondSceneLog, judged, first=origin)
        await self._memory.keep()
        return max((header for header in shown if header is not None), key=lambda header: header.position, default=None)

    async def newest(self, header: SceneLogPublic | None = None, *, first: NodeId | None = None) -> ReadLog:
        """The log as its keepers have it now. `header`: any header of the scene, for it names them; `first`: which of them may know most.

        Unreachable if none answers, or has it any more; Refused (17) if we have no key to it any more, (9) if the scene was ended.
        """
        header = header or (await self.header() if self._read is None else self._newer_of(self._read.header))
        if header is None:
            raise LocalFault("the cluster does not know this scene", where=f"scene {self._name}")
        self._check_goes_on(header)
        before = None if self._read is None else self._read.header
        try:
            found = await self.keepers.newest(header, before, first)
        except (Unreachable, Refused) as problem:
            newer = await self._shown_now() if header.participants or isinstance(problem, Unreachable) else None
            if newer is not None:
                self._check_goes_on(newer)
            if isinstance(problem, Refused) or newer is None or newer.participants == header.participants:
                raise
            # Others decide by now.
            found = await self.keepers.newest(newer, before)
        if found is not None:
            self._check_goes_on(found.header)
            self._read = found
            self.keys = keys_with_log(self.keys, found.state)
        assert self._read is not None
        return self._read

    async def _shown_now(self) -> SceneLogPublic | None:
        """The newest header; None also if nobody shows any."""
        with suppress(Unreachable, Refused, PeerFault):
            return await self.header()
        return None

    @property
    def _end(self) -> SceneLogPublic | None:
        """The header by which the scene was ended, if that was met."""
        return self._followed if self._followed is not None and self._followed.mode is SceneMode.ENDED else None

    async def at_end(self, ended: SceneLogPublic) -> ReadLog:
        """The log of a scene that was ended, of who has not let go of it yet, to be asked what is in it. Unreachable, Refused or PeerFault if nobody shows it."""
        found = await self.keepers.newest(ended, None)
        assert found is not None
        return found

    def _check_goes_on(self, header: SceneLogPublic) -> None:
        """Refused (9) once the scene was ended: those who decided it have let go of its log, or will."""
        newest = self._newer_of(header)
        if newest.mode is SceneMode.ENDED:
            raise scene_ended(newest.position, self._name)

    async def newer(self, told_by: NodeId | None) -> ReadLog:
        """`newest`; of the node that says that there is a newer one, if it shows that. What it shows was decided, and it decides what comes next."""
        read, found = self._read, None
        if told_by is not None and read is not None and read.header.participants:
            with suppress(Unreachable, Refused, PeerFault, DamagedData):
                found = await self.keepers.of(told_by, read.header)
        if found is None:
            return await self.newest(first=told_by)
        self._check_goes_on(found.header)
        self._read = found
        self.keys = keys_with_log(self.keys, found.state)
        return found

    def _newer_of(self, header: SceneLogPublic) -> SceneLogPublic:
        """That header, or the one that was met last, which may name others who keep the log."""
        followed = self._followed
        return header if followed is None or followed.position < header.position else followed

    async def _opened(self, public: SceneLogPublic, private: bytes) -> ReadLog:
        await self._memory.keep()
        key = self.keys.epochs.get(public.key_epoch)
        if key is None:
            raise key_withheld(f"scene {self._name}")
        opening = partial(_opened, public, private, key, self.keys.header_key, self._read)
        return await self._calls.world.workers.run("crypto", opening)

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

    def request(self, want: Want, have: int) -> RequestSceneLog:
        """Packet 5 about this scene."""
        nonce = int.from_bytes(self._calls.world.entropy.token(8), "big")
        return RequestSceneLog(self.keys.scene_id, self.keys.genesis, have, nonce, want)


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
    check_told(header, log.state, is_shortened=log.snapshot is not None)
    return ReadLog(header, log)
