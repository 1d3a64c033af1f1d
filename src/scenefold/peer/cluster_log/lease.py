"""The owner lease: until when this node may speak for its arc (design page storage; specs/15-cluster-log.md, Lease).

Under a lease a node acknowledges writes, judges what a writer expects, and says that nothing is there. It runs from the
moment of *asking*, on this node's own clock, so it ends here before the voter may give the arc to anybody else: the
voter waits T_WAIT_S, five percent longer, from the moment of its answer. It is in memory only and does not survive a
restart. It is asked for under a life, by which the voter knows a restored backup (own_life.py). `holds` is asked at the moment of answering, never before a wait.
"""

from __future__ import annotations

import logging
import math

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.reasons import RejectReason
from scenefold.peer.cluster_log.cluster_log import ClusterLog
from scenefold.peer.cluster_log.own_life import OwnLife
from scenefold.peer.cluster_log.voted_lease import VotedLease
from scenefold.peer.membership.status import OwnStatus
from scenefold.peer.timing import LEASE_RETRY_S, RENEW_S, T_LEASE_S
from scenefold.store import Store
from scenefold.world import World
from scenefold.world.quiet import QuietLog
from scenefold.world.waking import sleep_until

_log = logging.getLogger("scenefold.peer.cluster_log.lease")


class OwnerLease:
    """This node's lease. Used from the Trio thread only."""

    def __init__(self, world: World, store: Store, cluster_log: ClusterLog, own: OwnStatus) -> None:
        self._world = world
        self._cluster_log = cluster_log
        self._own = own
        self._until = -math.inf
        self._life = OwnLife(world, store)
        self._voted = VotedLease(world, store, cluster_log.voting, own.member)
        self._voted.granted = self._has_grown
        self._news = trio.Event()
        self._quiet = QuietLog(_log)
        self.rolled_back = trio.Event()
        """Set once the voter has said that it granted this incarnation a life that our disk does not know."""
        self.begun = trio.Event()
        """Set once this process has had a lease, which it may have lost since: its disk is no older one, as far as the voters know (lives.py)."""
        self.revoked = trio.Event()
        """Set once the voter has said that the key of this node counts no longer."""

    def holds(self) -> bool:
        """Whether this node may speak for its arc at this moment."""
        return self._world.clock.now() < self._until and self._cluster_log.registry.is_current(self._own.member)

    @property
    def seconds_left(self) -> float:
        """For reports: how long the lease would hold without being renewed."""
        return max(0.0, self._until - self._world.clock.now()) if self.holds() else 0.0

    async def held(self) -> None:
        """Return once the lease is held."""
        while not self.holds():
            await self._news.wait()

    async def run(self) -> None:
        """Renew the lease until cancelled, whenever this node is a member."""
        await self._life.load()
        while True:
            await self._membership()
            if self._cluster_log.is_by_votes:
                await self._ask_voters()
                continue
            asked_at = await self._ask()
            if asked_at is None:
                await self._world.clock.sleep(LEASE_RETRY_S)
            elif self._life.granted(asked_at):
                self._grown_to(asked_at + T_LEASE_S)
                await sleep_until(self._world.clock, asked_at + RENEW_S)
            # Else it was granted under an old life, and the next is drawn and asked with at once.

    async def _membership(self) -> None:
        registry = self._cluster_log.registry
        while not registry.is_current(self._own.member):
            # Who was removed speaks for nothing from the moment of learning it.
            self._until = -math.inf
            self._voted.removed()
            registry = await self._cluster_log.changed_after(registry.position)

    async def _ask(self) -> float | None:
        """When it was asked for, if it was granted."""
        try:
            await self._life.renew()
        except Refused as refusal:
            self._complain(f"no lease is asked for until the disk takes a note of it: {refusal}")
            return None
        asked_at = self._world.clock.now()
        try:
            return asked_at if await self._cluster_log.ask_lease(self._life.lives) else None
        except Refused as refusal:
            if refusal.reason is RejectReason.WRONG_INCARNATION:
                await self._no_longer(refusal)
            elif refusal.reason is RejectReason.KEY_REVOKED:
                self._until = -math.inf
                self.revoked.set()
            else:
                self._complain(f"the voter grants no lease: {refusal}")
        except (Unreachable, PeerFault) as problem:
            self._complain(f"no lease from the voter: {problem}")
        return None

    async def _ask_voters(self) -> None:
        """Once, of all voters, and wait until it is time again."""
        await self._cluster_log.voting.voted.opened.wait()
        asked_at, before = self._world.clock.now(), self._voted.until
        try:
            problem = await self._voted.ask(self._life.lives, self._cluster_log.registry)
        except Refused as refusal:
            problem = f"none is asked for until the disk takes a note of it: {refusal}"
        if self._voted.is_restored:
            await self._no_longer("the disk of this node is a restored backup: it has had a lease since that its disk does not know of")
        if self._voted.is_revoked:
            self._until = -math.inf
            self.revoked.set()
        if problem:
            self._complain(f"no lease: {problem}")
            await self._world.clock.sleep(LEASE_RETRY_S)
        elif self._voted.until > before:
            await sleep_until(self._world.clock, asked_at + RENEW_S)
        # Else it was granted under an old life, and the next is drawn and asked with at once.

    def _has_grown(self) -> None:
        self._grown_to(self._voted.until)

    def _grown_to(self, until: float) -> None:
        if until > -math.inf:
            # Under a life that this process has drawn.
            self.begun.set()
        self._until = max(self._until, until)
        self._news.set()
        self._news = trio.Event()

    async def _no_longer(self, why: object) -> None:
        """Removed, which the log says too, or rolled back, which only voters know."""
        self._until = -math.inf
        await self._cluster_log.pull()
        if self._cluster_log.registry.is_current(self._own.member):
            _log.warning("%s", why)
            self.rolled_back.set()

    def _complain(self, text: str) -> None:
        if not self.holds():
            self._quiet.say(self._world.clock.now(), "lease", "lease", text)
