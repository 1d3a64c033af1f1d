"""The cluster's log as a client knows it: asked of several nodes, verified, and kept (specs/15-cluster-log.md, Who is who).

A node can show the log of yesterday, but no other one, and none older than what this profile has seen. So the longest of several answers
counts; every answer of a node tells how far it knows the log, and whoever claims to know more is asked for it. That is a hint alone: whatever is
claimed, several are asked once a minute. Keys that the log has revoked are talked to no more: neither a node's, nor by us under our own.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Sequence
from functools import partial

import trio

from scenefold.base.errors import DamagedData, LocalFault, PeerFault, Refused, ScenefoldError
from scenefold.base.ids import KeyId, NodeId
from scenefold.base.reasons import RejectReason
from scenefold.client.calls import Calls
from scenefold.crypto import HEADER_DOMAIN, PublicKey, node_named
from scenefold.wire import (
    DecidedLog,
    MalformedPacket,
    RequestSceneLog,
    RespondSceneLog,
    SceneLogAnswer,
    SceneLogPublic,
    UnknownEntry,
    Want,
    unpack_log,
)
from scenefold.world import Connection, Priority
from scenefold.world.log_file import LogFile
from scenefold.world.log_view import KeptRecord, LogView

LOOK_S = 60.0
"""A client asks several nodes so often, whatever those that it talks to claim."""
PAUSE_S = 1.0
"""Between two looks, so that who claims more and more binds little of us."""
PUZZLES_MAX = 256
"""Certificates that others are asked for in LOOK_S; for more than that the next look has to do."""
CLAIMANTS_MAX = 2
SETTLE_S = 1.0

Known = tuple[LogView, Sequence[KeptRecord]]
"""A view, and the records that it is the fold of."""
NOTHING_KNOWN: Known = (LogView(), ())

_log = logging.getLogger("scenefold.client.log")


class KnownLog:
    """Of one client. `view` is the newest; `changed` is called after each that is newer."""

    def __init__(
        self,
        calls: Calls,
        genesis: SceneLogPublic,
        log_key: PublicKey,
        voter: NodeId,
        me: tuple[str, KeyId],
        file: LogFile | None = None,
        known: Known = NOTHING_KNOWN,
        changed: Callable[[], None] = lambda: None,
    ) -> None:
        """`me`: our name, and the id of the key that we sign with. `known`: what lies in `file`."""
        self._calls = calls
        self._genesis = genesis
        self._log_key = log_key
        self._voter = voter
        self._me = me
        self._file = file
        self.view, self._records = known[0], list(known[1])
        self._changed = changed
        self._taking = trio.Lock()
        self._following = trio.Lock()
        self._claims: dict[str, int] = {}
        self._claimed = trio.Event()
        self._is_puzzled = False
        """Whether somebody showed a key that the log may tell of by now."""
        self._puzzles: dict[tuple[str, KeyId | None], tuple[int, float]] = {}
        """The log's position at which others were last asked for that, and when."""
        self._asked_at = -math.inf

    @property
    def voters(self) -> Sequence[NodeId]:
        """Who decides the cluster's log, as far as is known here."""
        voters = self.view.voters
        return (self._voter,) if voters is None else sorted(voters.nodes)

    # ------------------------------------------------------------------------------------------------- who counts

    def refusal_of(self, connection: Connection) -> Refused | None:
        """Why a node that answers is not talked to."""
        refusal = self.view.refusal_of(connection.peer, connection.peer_key)
        node, key = node_named(connection.peer), connection.peer_key
        if refusal is None and node is not None and self.view.has_known(node):
            known = self.view.keys_of(node)
            if known is None or key != known.signing_id:
                self._puzzled_by(connection.peer, key)
                refusal = Refused(
                    RejectReason.NOT_READY, f"its certificate is for another key than the cluster's log has for {connection.peer}"
                )
        return refusal

    def _puzzled_by(self, peer: str, key: KeyId | None) -> None:
        """A certificate of which the log does not tell, or not yet: others are asked soon whether it does.

        As long as nothing else is heard, once in LOOK_S for each: whoever shows one may do so at every look.
        """
        now = self._calls.world.clock.now()
        position, at = self._puzzles.get((peer, key), (-1, -math.inf))
        if position == self.view.position and now - at < LOOK_S:
            return
        self._puzzles = {who: what for who, what in self._puzzles.items() if what[0] == self.view.position and now - what[1] < LOOK_S}
        if len(self._puzzles) < PUZZLES_MAX:
            self._puzzles[peer, key] = self.view.position, now
            self._is_puzzled = True
            self._claimed.set()

    def check_own(self) -> None:
        """Refused if our own key counts no longer: no honest node would answer."""
        refusal = self.view.refusal_of(*self._me)
        if refusal is not None:
            raise refusal

    # --------------------------------------------------------------------------------------------------- learning

    def heard(self, address: str, position: int) -> None:
        """A node has answered something, and claims to know the log so far."""
        if position > self.view.position:
            self._claims[address] = position
            self._claimed.set()

    async def run(self) -> None:
        """Follow the log until cancelled."""
        clock = self._calls.world.clock
        looked_at = clock.now()
        while True:
            # Nobody who claims something, or is slow to show it, may put this off.
            with trio.move_on_after(max(0.0, max(looked_at, self._asked_at) + LOOK_S - clock.now())) as look:
                await self._claimed.wait()
                await self._follow()
            if look.cancelled_caught or self._is_puzzled:
                self._is_puzzled = False
                looked_at = clock.now()
                try:
                    await self.newest()
                except ScenefoldError as problem:
                    _log.debug("the cluster's log is not told: %s", problem)
            await clock.sleep(PAUSE_S)

    def has_grown(self) -> None:
        """What was asked for before this moment is old, however short a time ago that was."""
        self._asked_at = -math.inf

    async def newest(self, *, age_s_max: float = 0.0) -> LogView:
        """The view after several nodes were asked, the one that decides the log among them. Unreachable if none answers.

        `age_s_max`: it may be as old as that.
        """
        began = self._calls.world.clock.now()
        if began - self._asked_at > age_s_max:
            await self._calls.several(self._pull, first=self.voters[0])
            self._asked_at = began
        return self.view

    async def settled(self) -> None:
        """What nodes claimed while a short command asked for something else, so that it is kept; or SETTLE_S over it."""
        with trio.move_on_after(SETTLE_S):
            await self._follow()

    async def _follow(self) -> None:
        """Ask some who claim to know more. Whatever one of them shows instead, the others are heard."""
        async with self._following:
            for address in self._claimants():
                claim = self._claims.pop(address, 0)
                if claim > self.view.position:
                    try:
                        await self._pull(address)
                    except ScenefoldError as problem:
                        _log.debug("the cluster's log is not told: %s", problem)
            self._claims = {address: claim for address, claim in self._claims.items() if claim > self.view.position}
            if not self._claims:
                self._claimed = trio.Event()

    def _claimants(self) -> list[str]:
        """Who is asked next: a voter, which knows, and others by chance, since whoever claims most may lie."""
        voters = [self._calls.address_of(voter) for voter in self.voters]
        chosen = [voter for voter in voters if voter in self._claims][:1]
        others = [address for address in self._claims if address not in chosen]
        while others and len(chosen) < CLAIMANTS_MAX:
            chosen.append(others.pop(int(self._calls.world.entropy.uniform() * len(others))))
        return chosen

    async def _pull(self, address: str) -> None:
        """Take all that a node has. PeerFault if that does not verify."""
        while self.view.voters is None:
            have = self.view.position
            packet = RequestSceneLog(self._genesis.scene, self._genesis.genesis, have, 0, Want.LOG)
            answer = (await self._calls.ask(address, packet, RespondSceneLog, priority=Priority.HIGH)).answer
            if answer is None:
                raise Refused(RejectReason.NOT_READY, "the node does not know the cluster's log yet", where=address)
            await self._take(partial(self._verified, answer), address)
            if self.view.voters is None and (self.view.position == have or self.view.position >= answer.position):
                return
        while True:
            have = self.view.position
            packet = RequestSceneLog(self._genesis.scene, self._genesis.genesis, have, 0, Want.DECIDED)
            decided = (await self._calls.ask(address, packet, RespondSceneLog, priority=Priority.HIGH)).decided
            if decided is None:
                # It does not know yet that votes decide.
                return
            await self._take(partial(self._voted, decided), address)
            if self.view.position == have or self.view.position >= decided.newest:
                return

    async def _take(self, verified: Callable[[], tuple[LogView, list[KeptRecord]]], address: str) -> None:
        async with self._taking:
            try:
                view, fresh = await self._calls.world.workers.run("crypto", verified)
            except UnknownEntry as problem:
                raise PeerFault(f"the cluster's log cannot be read: {problem.what}", where=address, remedy=problem.remedy) from problem
            except (MalformedPacket, DamagedData, Refused) as problem:
                raise PeerFault(f"the node's log of the cluster does not verify: {problem}", where=address) from problem
            if not fresh:
                return
            self.view = view
            self._records += fresh
            self._changed()
            if self._file is not None:
                await self._keep(self._file)

    def _voted(self, decided: DecidedLog) -> tuple[LogView, list[KeptRecord]]:
        if decided.genesis != self._genesis.genesis:
            raise DamagedData("it is that of another cluster")
        return self.view.after(decided.decided, self._log_key, decided.genesis)

    def _verified(self, answer: SceneLogAnswer) -> tuple[LogView, list[KeptRecord]]:
        if answer.public.genesis != self._genesis.genesis:
            raise DamagedData("it is that of another cluster")
        self._log_key.verify(answer.public.signature, HEADER_DOMAIN, answer.public.signable())
        return self.view.after(unpack_log(answer.private) if answer.private else (), self._log_key)

    async def _keep(self, file: LogFile) -> None:
        try:
            await self._calls.world.workers.run("import", file.save, tuple(self._records))
        except (LocalFault, OSError) as problem:
            # A profile may be where nothing can be written: then the next client asks again.
            _log.info("the cluster's log is not kept in the profile: %s", problem)
