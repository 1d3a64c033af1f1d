"""Between a voter's log and its desk (specs/26-modes.md, The cluster's log): who is not awake, or not ready, does not vote; who has voted grants
nothing until that is decided."""

from __future__ import annotations

import logging
from collections.abc import Callable

import trio

from scenefold.base.errors import Refused
from scenefold.base.reasons import RejectReason
from scenefold.consensus import Decide, Judge, Slot, Value
from scenefold.peer.cluster_log.cluster_judge import record_in
from scenefold.peer.cluster_log.lease_desk import LeaseDesk
from scenefold.peer.logs import Owner
from scenefold.peer.timing import PROPOSE_RETRY_S
from scenefold.wire import AddParticipant, LogRecord, MalformedPacket, RemoveParticipant
from scenefold.world import QuietLog, World

_log = logging.getLogger("scenefold.peer.cluster_log.cluster_log")


class VoterOwner(Owner):
    """Owner of the cluster's log at one of several voters. `desk` is set before the log runs, and `run` beside it."""

    desk: LeaseDesk

    def __init__(self, world: World) -> None:
        self._world = world
        self._news = trio.Event()
        self._quiet = QuietLog(_log)
        self.has_accepted = False
        """This node has voted for what is not decided here, or is about to."""
        self.objects: Callable[[LogRecord], RejectReason | None] = lambda _record: None
        """What this node has against what another one proposes."""
        self.heard: Callable[[Decide, Judge], None] = lambda _decided, _after: None
        """Called with what is decided."""

    def speaks(self) -> bool:
        return self.desk.is_awake

    def veto(self, value: Value | None) -> RejectReason | None:
        try:
            return None if value is None else self.objects(record_in(value))
        except MalformedPacket:
            # The judge refuses it.
            return None

    def abstains(self, value: Value) -> bool:
        try:
            entry = record_in(value).entry
        except MalformedPacket:
            # Nobody has judged it yet.
            return True
        return not self.desk.may_vote(changes_voters=isinstance(entry, AddParticipant | RemoveParticipant))

    def votes(self, value: Value) -> None:
        """A proposer's own vote comes here alone."""
        if self.abstains(value):
            raise Refused(RejectReason.NOT_READY, "this voter does not know yet what those before it granted")
        self.has_accepted = True

    def stands(self, slot: Slot, *, is_silent: bool) -> None:
        self.has_accepted = slot.accepted is not None or is_silent
        self._news.set()

    def decided(self, decided: Decide, after: Judge) -> None:
        self._news.set()
        self.heard(decided, after)

    async def run(self) -> None:
        """Let the desk look at what has changed, until cancelled."""
        while True:
            await self._news.wait()
            self._news = trio.Event()
            try:
                await self.desk.look()
            except Refused as refusal:
                self._quiet.say(
                    self._world.clock.now(), "desk", "desk", f"no leases are granted until the disk takes what was told: {refusal}"
                )
                await self._world.clock.sleep(PROPOSE_RETRY_S)
                self._news.set()
