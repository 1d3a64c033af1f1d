"""A node asks all voters for its owner lease, and draws its lives (specs/26-modes.md, Owner leases; Lives, with a majority). The rules are
those of lease_asker.py; here is what they need of a node: a disk, dice, and the voters."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from dataclasses import replace

import trio

from scenefold.base.errors import DamagedData, PeerFault, Refused, Unreachable
from scenefold.base.ids import address_of
from scenefold.base.reasons import RejectReason
from scenefold.peer.cluster_log.lease_asker import LeaseAsker
from scenefold.peer.cluster_log.lease_grants import Question
from scenefold.peer.cluster_log.lives import LIFE_BYTES, Lives, drawn_from
from scenefold.peer.cluster_log.numbered_lives import Life, of_one_voter, unpack_life
from scenefold.peer.cluster_log.registry import Registry
from scenefold.peer.cluster_log.voting import Voting
from scenefold.peer.timing import LEASE_ASK_S_MAX, RENEW_S
from scenefold.store import Store
from scenefold.wire import Member
from scenefold.world import World
from scenefold.world.quiet import QuietLog

NOTE = "cluster-log/own-life"
LINGER_S = 0.3
"""So long those are waited for who have not answered when a majority has."""

_log = logging.getLogger("scenefold.peer.cluster_log.lease")


class VotedLease:
    """Used by the lease alone, one call at a time. `until`: of the lease, by this node's clock."""

    def __init__(self, world: World, store: Store, voting: Voting, me: Member) -> None:
        self._world, self._store, self._voting, self._me = world, store, voting, me
        self._asker: LeaseAsker | None = None
        self._quiet = QuietLog(_log)
        self.is_revoked = False
        """A voter has said that the key of this node counts no longer."""
        self.granted: Callable[[], None] = lambda: None
        """Called when a lease begins, or is renewed."""

    @property
    def until(self) -> float:
        return -math.inf if self._asker is None else self._asker.until

    @property
    def is_restored(self) -> bool:
        """The voters know of a later life, so that this disk is an older one; where this node votes, one of them is enough until it speaks."""
        return self._voting.is_restored or (self._asker is not None and self._asker.is_restored)

    def removed(self) -> None:
        """The log says that this incarnation is a member no more."""
        if self._asker is not None:
            self._asker = self._asker.removed()

    async def ask(self, lives: Lives, registry: Registry) -> str:
        """Ask once; empty if the lease was granted, else why not. `lives`: what the disk holds from the time of one voter.

        Refused if the disk has no room for a life, and this process has drawn none yet.
        """
        asker = await self._with_life(lives)
        voters = registry.voting.deciders
        assert voters is not None and asker.life is not None
        nonce = int.from_bytes(self._world.entropy.token(8), "big")
        self._asker = asker.asks(nonce, registry.position, voters, self._world.clock.now())
        question = Question(self._me, registry.position, asker.life, nonce)
        silent: list[str] = []
        with trio.move_on_after(LEASE_ASK_S_MAX) as scope:
            async with trio.open_nursery() as nursery:
                for one in voters.everyone:
                    nursery.start_soon(self._ask_one, one.member, question, scope, silent)
        if self._asker.round is None and not self._asker.is_restored:
            return ""
        return f"of {len(voters.everyone)} voters too few grant it{': ' if silent else ''}{'; '.join(sorted(silent))}"

    async def _ask_one(self, voter: Member, question: Question, scope: trio.CancelScope, silent: list[str]) -> None:
        assert self._asker is not None
        try:
            if not await self._voting.ask_lease(voter, question):
                silent.append(f"{address_of(voter.node)} does not now")
                return
            self._asker = self._asker.granted(question.nonce, voter)
        except Refused as refusal:
            self.is_revoked = self.is_revoked or refusal.reason is RejectReason.KEY_REVOKED
            self._asker = self._asker.refused(question.nonce, voter, refusal.reason)
            silent.append(f"{address_of(voter.node)}: {refusal.what}")
        except (Unreachable, PeerFault) as problem:
            silent.append(f"{address_of(voter.node)}: {problem.what}")
        if self._asker.round is None:
            scope.deadline = min(scope.deadline, trio.current_time() + LINGER_S)
            self.granted()

    async def _with_life(self, lives: Lives) -> LeaseAsker:
        """With a life to ask under: durable on return."""
        asker, now = self._asker or await self._of_disk(lives), self._world.clock.now()
        if asker.wants_life(now):
            drawn = asker.drawn(drawn_from(self._world.entropy.token(LIFE_BYTES)), now)
            assert drawn.life is not None
            try:
                await self._store.put_note(NOTE, drawn.life.pack())
                asker = drawn
            except Refused as refusal:
                if asker.drawn_at == -math.inf:
                    raise
                self._quiet.say(now, "life", "life", f"no new life can be written, so the old one serves on: {refusal}")
                asker = replace(asker, drawn_at=now - asker.life_s + RENEW_S)
        return asker

    async def _of_disk(self, lives: Lives) -> LeaseAsker:
        data = await self._store.get_note(NOTE)
        kept: tuple[Life, ...] = of_one_voter(lives)
        try:
            kept = kept if data is None else (unpack_life(data),)
        except DamagedData as damage:
            # The voters will not know what is drawn next, and this node begins anew.
            _log.error("%s", damage)
            kept = ()
        return LeaseAsker.of_disk(kept)
