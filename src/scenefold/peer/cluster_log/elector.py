"""A voter among several: it has decided by votes what others propose to it (specs/15-cluster-log.md, Voters).

What is judged by the voter alone (log_rules.py, and what follows here) is judged when the value is made, so before anybody promises anything;
what the others have against it they say then.
"""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable

from scenefold.base.errors import Refused, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.base.reasons import RejectReason
from scenefold.consensus import Judge, Outcome, Value
from scenefold.peer.cluster_log.beginnings import Beginnings
from scenefold.peer.cluster_log.cluster_judge import ClusterJudge, value_of
from scenefold.peer.cluster_log.log_rules import BEGAN_ANEW, check_proposer, committed_at, in_words, predecessor
from scenefold.peer.cluster_log.log_voter import Veto, check_not_vetoed
from scenefold.peer.cluster_log.missed import Missed
from scenefold.peer.cluster_log.voted_log import VotedLog
from scenefold.peer.logs import Answer
from scenefold.peer.timing import T_WAIT_S
from scenefold.wire import AddNode, AddParticipant, LogEntry, LogRecord, Member, RemoveNode, RemoveParticipant
from scenefold.world import QuietLog, World
from scenefold.world.facts import ClusterFacts

_OF_BALLOTS = frozenset({RejectReason.POSITION_TAKEN, RejectReason.NOT_AUTHORISED, RejectReason.SIGNATURE_INVALID})
DECIDE_S = 9.0
"""For the voters to decide: whoever asked waits a little longer."""

_log = logging.getLogger("scenefold.peer.cluster_log.cluster_log")


class Elector:
    """At any node; only where that is a voter, and awake, it proposes. `me`: its id."""

    def __init__(self, world: World, facts: ClusterFacts, me: NodeId, voted: VotedLog) -> None:
        self._world, self._facts, self._me, self._voted = world, facts, me, voted
        self._started_at = world.clock.now()
        self._beginnings = Beginnings()
        self._missed = Missed()
        self._quiet = QuietLog(_log)
        self.veto: Veto | None = None
        """Asked about removals that another node proposes to this voter: a reason against it, or None."""
        self.evidence: Callable[[Member], str | None] = lambda _member: None
        """Likewise of what other voters propose, without asking anybody."""
        self.answers: Callable[[NodeId], Awaitable[bool]] | None = None
        """Whether a node answers, and has come to what is decided here."""
        voted.owner.objects = self.objects

    async def decide(self, entry: LogEntry, request_id: bytes, proposer: NodeId) -> int:
        """Have an entry decided; its position. Refused with the reason: it never will be by what this voter did. Unreachable: it may be."""
        voted = self._voted
        if not voted.opened.is_set():
            raise Refused(RejectReason.NOT_READY, "the voters of the cluster's log do not decide yet", remedy="try again in a moment")
        if not voted.is_voter:
            raise Refused(RejectReason.NOT_MY_LOCATION, "the cluster's log is decided elsewhere")
        if not voted.desk.is_awake:
            raise Refused(RejectReason.NOT_READY, "this voter has not heard from enough others since its start", remedy="ask another voter")
        registry = voted.registry
        if committed_at(entry, request_id, registry) is None:
            check_proposer(entry, proposer, registry, self._facts, self._world.clock.wall())
            await self._look(entry, proposer)
        position = await self._voted_for(entry, request_id, proposer)
        if isinstance(entry, AddNode):
            self._beginnings.count(proposer, self._world.clock.now())
        return position

    async def _look(self, entry: LogEntry, proposer: NodeId) -> None:
        """At what takes time, or more than the log. Refused if something speaks against the entry."""
        registry = self._voted.registry
        match entry:
            case RemoveNode(member):
                if self._hears(entry, proposer):
                    raise Refused(RejectReason.BUSY, f"{address_of(member.node)} is not removed: this voter hears it")
                await check_not_vetoed(member, proposer, registry, self.veto)
            case AddNode():
                now = self._world.clock.now()
                try:
                    self._beginnings.check(proposer, now)
                except Refused as refusal:
                    self._quiet.say(now, address_of(proposer), "beginnings", refusal.what)
                    raise
                old = predecessor(entry, registry)
                if old is not None:
                    await self._retire(old)
            case AddParticipant(member):
                self._check_ready()
                if member.node != self._me and self.answers is not None and not await self.answers(member.node):
                    what = f"{address_of(member.node)} does not answer, or has not taken the cluster's log yet: it could decide nothing"
                    raise Refused(RejectReason.NOT_READY, what, remedy="start it, then try again")
            case RemoveParticipant():
                self._check_ready()

    def _check_ready(self) -> None:
        if not self._voted.desk.may_vote(changes_voters=True):
            what = "this voter has not heard yet what those before it granted"
            raise Refused(RejectReason.NOT_READY, what, remedy="try again in a while")

    async def _retire(self, old: Member) -> None:
        """Remove the incarnation before a new one, as a voter too, once no lease that this voter granted it can be alive."""
        desk = self._voted.desk
        since = desk.leased_at(old.node)
        wait_s = (self._started_at if since is None else since) + T_WAIT_S - self._world.clock.now()
        if wait_s >= 0:
            raise Refused(RejectReason.BUSY, f"id in use: {address_of(old.node)} may hold a lease for {wait_s:.0f} s more")
        if old in self._voted.log.judge.participants:
            self._check_ready()
            await self._voted_for(RemoveParticipant(old), self._world.entropy.token(16), self._me)
        await self._voted_for(RemoveNode(old, BEGAN_ANEW), self._world.entropy.token(16), self._me)

    async def _voted_for(self, entry: LogEntry, request_id: bytes, origin: NodeId) -> int:
        def make(judge: Judge) -> Value:
            assert isinstance(judge, ClusterJudge)
            registry = judge.registry
            if committed_at(entry, request_id, registry) is None:
                check_proposer(entry, origin, registry, self._facts, self._world.clock.wall())
            return value_of(LogRecord(registry.position + 1, registry.head, request_id, origin, entry))

        # Who is not heard by some is removed only if nobody who decides, and is there, objects.
        is_for_all = isinstance(entry, RemoveNode) and origin != entry.member.node
        if isinstance(entry, RemoveNode) and self._missed.is_for_long(entry.member, self._world.clock.now()):
            is_for_all = False
        answer = await self._voted.log.ask(make, DECIDE_S, is_for_all=is_for_all)
        if isinstance(entry, RemoveNode):
            self._note_missed(entry, answer)
        if answer.outcome is Outcome.COMMITTED:
            _log.info("cluster log, position %d: %s", answer.position, in_words(entry))
            return answer.position
        if answer.outcome is Outcome.REJECTED and answer.reason is not None:
            by = self._me if answer.by is None else answer.by
            # What speaks against the entry itself was said when the value was made: these are about who votes, and about ballots.
            reason = RejectReason.BUSY if answer.reason in _OF_BALLOTS else answer.reason
            words = reason.name.lower().replace("_", " ")
            raise Refused(reason, f"the voters do not decide a {type(entry).__name__}: {words}", where=address_of(by))
        raise Unreachable(f"not enough voters have answered, and a {type(entry).__name__} may be decided yet", where=address_of(self._me))

    def _note_missed(self, entry: RemoveNode, answer: Answer) -> None:
        if answer.outcome is Outcome.REJECTED and answer.reason is RejectReason.PEER_MISSED:
            self._missed.note(entry.member, answer.by, self._world.clock.now())
        else:
            self._missed.clear(entry.member)

    # -------------------------------------------------------------------------------------------- as one of the others

    def objects(self, record: LogRecord) -> RejectReason | None:
        """What this voter has against something that another one proposes: whom it hears is not removed, whoever does not hear it."""
        entry = record.entry
        if isinstance(entry, RemoveNode) and self._voted.is_voter and self._hears(entry, record.origin):
            return RejectReason.BUSY
        return None

    def _hears(self, entry: RemoveNode, origin: NodeId) -> bool:
        """Whether this voter knows that somebody lives whom another one wants to be removed."""
        registry, node = self._voted.registry, entry.member.node
        if origin == node or not registry.stands(node) or registry.is_barred(node):
            return False
        leased_at = self._voted.desk.leased_at(node)
        if leased_at is not None and self._world.clock.now() - leased_at < T_WAIT_S:
            return True
        # Who has begun anew has said so itself: that it was heard, as another one, says nothing.
        return entry.reason != BEGAN_ANEW and self.evidence(entry.member) is not None

    def lapsed(self, learnt_at: Callable[[int], float]) -> list[NodeId]:
        """Members, but for voters, that this voter has granted no lease for longer than one lasts."""
        if not self._voted.is_voter or not self._voted.desk.may_vote(changes_voters=True):
            return []
        registry, now, silent = self._voted.registry, self._world.clock.now(), list[NodeId]()
        begun = max(self._started_at, learnt_at(registry.voting.councils[-1].position))
        for node in registry.members:
            known, leased_at = registry.current(node), self._voted.desk.leased_at(node)
            assert known is not None
            since = max(begun if leased_at is None else leased_at, learnt_at(known.position))
            if node not in registry.voters and now - since > T_WAIT_S:
                silent.append(node)
        return silent
