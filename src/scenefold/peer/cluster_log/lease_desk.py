"""A voter at work, as one of several: it answers who asks for leases, hears lives and tells them (specs/26-modes.md, The cluster's log).

The rules are those of lease_grants.py and telling_lives.py; here is what they need of a node: a disk, a clock, and the log as it goes on. What
is granted was durable before, and was looked at once more afterwards.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import trio

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.peer.cluster_log import telling_lives
from scenefold.peer.cluster_log.awakening import Awakening
from scenefold.peer.cluster_log.held_notes import changed_notes, granted_alone, load_held
from scenefold.peer.cluster_log.lease_grants import KEPT_S, Held, Question, Verdict, answer, noted
from scenefold.peer.cluster_log.numbered_lives import Life, merged
from scenefold.peer.cluster_log.registry import Registry
from scenefold.peer.cluster_log.telling_lives import Gathering
from scenefold.peer.cluster_log.voter_rules import Council
from scenefold.store import Store
from scenefold.wire import Member
from scenefold.world import World

_WORDS = {
    RejectReason.NOT_AUTHORISED: "it is no member under this incarnation",
    RejectReason.WRONG_INCARNATION: "this incarnation is over, or its disk is a restored backup: it has had a lease since that its disk does not know of",
    RejectReason.ILL_FORMED: "a lease is asked for under a life whose mark is not 0",
}


@dataclass(frozen=True, slots=True)
class RegistryLog:
    """The log as the rules of leases see it."""

    registry: Registry

    @property
    def position(self) -> int:
        return self.registry.position

    @property
    def councils(self) -> tuple[Council, ...]:
        return self.registry.voting.councils

    def bars(self, member: Member) -> RejectReason | None:
        if self.registry.removal(member.incarnation) is not None:
            return RejectReason.WRONG_INCARNATION
        return None if self.registry.is_current(member) else RejectReason.NOT_AUTHORISED


class LeaseDesk:
    """Of a node that knows who votes. Used from the Trio thread only. `registry`: of what is decided here, durably; `has_accepted`: this node
    has voted behind it, or is about to."""

    def __init__(self, world: World, store: Store, me: Member, registry: Callable[[], Registry], has_accepted: Callable[[], bool]) -> None:
        self._world, self._store, self._me = world, store, me
        self._registry, self._has_accepted = registry, has_accepted
        self._held, self._gathering, self._awakening = Held(), Gathering(), Awakening()
        self._writing = trio.Lock()
        self._news = trio.Event()
        self._looked = trio.Event()
        self._newest: dict[bytes, int] = {}
        self._leased_at: dict[NodeId, float] = {}
        self.woke: Callable[[], None] = lambda: None
        """Called once this node may promise and vote."""

    @property
    def is_awake(self) -> bool:
        """Whether this node may promise and vote."""
        return self._awakening.is_awake

    @property
    def is_restored(self) -> bool:
        """Another voter knows of a later life of this node, so that this disk is an older one."""
        return self._awakening.is_over

    @property
    def held(self) -> Held:
        """As it is on the disk."""
        return self._held

    async def load(self) -> None:
        """Take what this node kept. DamagedData if it cannot be read."""
        held, log = await load_held(self._store), self._log()
        if log.councils and self._me in log.councils[0].voters:
            held = replace(held, lives=merged(await granted_alone(self._store, log.registry.members), held.lives))
        self._held = held
        await self.look()

    async def look(self) -> None:
        """At the log and at what is accepted, which have changed. Refused if the disk is full: then this node is not ready yet."""
        self._news.set()
        self._news = trio.Event()
        async with self._writing:
            gathering, held = telling_lives.gather(self._gathering, self._held, self._log(), self._me)
            await self._keep(held)
            self._gathering = gathering
        self._look_awake()
        self._has_looked()

    async def looked(self) -> None:
        """Return once of whom lives are to be heard may have changed."""
        await self._looked.wait()

    def leased_at(self, node: NodeId) -> float | None:
        """Local time of the newest lease that this voter granted a node; None since this start."""
        return self._leased_at.get(node)

    # ---------------------------------------------------------------------------------------------------- leases

    async def grant(self, question: Question) -> bool:
        """Whether the asker, whose signature was verified, has this voter's word for a lease. Refused with the reason: 12, 18, 5; 11 if the disk is full."""
        asker = question.member.incarnation
        self._newest[asker] = question.nonce
        try:
            is_granted = await self._granted(question, self._world.clock.now() + KEPT_S)
            if is_granted:
                self._leased_at[question.member.node] = self._world.clock.now()
            return is_granted
        finally:
            if self._newest.get(asker) == question.nonce:
                del self._newest[asker]

    async def _granted(self, question: Question, until: float) -> bool:
        while True:
            news = self._news
            said = self._answer(question)
            if isinstance(said, RejectReason):
                raise Refused(said, _WORDS[said])
            if said is Verdict.NOTE:
                async with self._writing:
                    if self._answer(question) is Verdict.NOTE:
                        await self._keep(noted(self._held, question))
            elif said is not Verdict.WAIT:
                return said is Verdict.GRANT
            elif not await self._changed(news, until) or self._newest.get(question.member.incarnation) != question.nonce:
                # Whoever asks anew waits for the answer to that.
                return False

    def _answer(self, question: Question) -> Verdict | RejectReason:
        return answer(question, self._held, self._log(), self._me, is_awake=self.is_awake, has_accepted=self._has_accepted())

    async def _changed(self, news: trio.Event, until: float) -> bool:
        """Whether the log, or what is accepted, is another one before the time is over."""
        left_s = until - self._world.clock.now()
        if left_s <= 0:
            return False
        with trio.move_on_after(left_s):
            await news.wait()
            return True
        return False

    # ----------------------------------------------------------------------------------------------------- lives

    def may_vote(self, *, changes_voters: bool) -> bool:
        """Whether this node votes for a record, which may change who votes."""
        return self.is_awake and telling_lives.may_vote(changes_voters=changes_voters, held=self._held, log=self._log(), me=self._me)

    def to_ask(self) -> tuple[int, tuple[Member, ...]]:
        """Of whom lives are to be heard, and as of which change of voters."""
        return self._gathering.council_at, telling_lives.to_ask(self._gathering, self._log())

    def tell(self, council_at: int) -> Mapping[bytes, Life]:
        """To one that votes since then. Refused (16) if this node does not know of that, or cannot tell."""
        if not telling_lives.may_tell(council_at, self._held, self._log(), self._me):
            raise Refused(RejectReason.NOT_READY, f"no lives are told here of those who voted until position {council_at}")
        registry = self._registry()
        return {incarnation: life for incarnation, life in self._held.lives.items() if registry.removal(incarnation) is None}

    async def told(self, teller: Member, council_at: int, lives: Mapping[bytes, Life]) -> None:
        """All that one of those before tells. Refused if the disk is full."""
        async with self._writing:
            log = self._log()
            gathering, held = telling_lives.told(self._gathering, self._held, teller, council_at, lives, log, is_all=True)
            await self._keep(held)
            self._gathering = gathering
        self._has_looked()

    def heard(self, voter: Member, *, is_refused: bool) -> None:
        """What another voter said to a question under this node's own life: 18, or something else that shows that it has looked at it."""
        self._awakening = self._awakening.answered(voter, is_refused=is_refused)
        self._look_awake()

    # ------------------------------------------------------------------------------------------------------ inside

    def _log(self) -> RegistryLog:
        return RegistryLog(self._registry())

    def _look_awake(self) -> None:
        councils, was_awake = self._log().councils, self.is_awake
        if councils:
            self._awakening = self._awakening.looked_at(councils[-1].voters, self._me)
        if self.is_awake and not was_awake:
            self.woke()

    def _has_looked(self) -> None:
        self._looked.set()
        self._looked = trio.Event()

    async def _keep(self, held: Held) -> None:
        """Durable first. Shielded: who asked may be gone, but what is believed here must not fall behind the disk."""
        registry = self._registry()
        with trio.CancelScope(shield=True):
            notes = changed_notes(self._held, held, lambda incarnation: registry.removal(incarnation) is not None)
            if notes:
                await self._store.put_notes(notes)
            self._held = held
