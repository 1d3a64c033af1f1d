"""Is it really silent? Direct and indirect probes, and the removal that may follow (specs/11-peers.md, Suspicion).

The states of a suspect, and when its turn comes, are in suspicion.py, what the voter holds against a removal in
removal.py; here is what happens on the network. A probe is RequestState, up to three times within about 2 s. If it is
not answered, two others that are believed alive are asked to probe for us (ProbeFor), and to bring a proof (proofs.py): a cut between
two nodes, or lost datagrams, remove nobody whom anybody hears, and nobody can vouch for the dead.
"""

from __future__ import annotations

import datetime
import logging
from collections.abc import Callable, Sequence
from enum import Enum, auto
from functools import partial

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.base.reasons import RejectReason
from scenefold.peer.cluster_log.cluster_log import ClusterLog
from scenefold.peer.cluster_log.registered import NO_INCARNATION
from scenefold.peer.cluster_log.registry import Registry
from scenefold.peer.handlers import Handlers, Senders
from scenefold.peer.membership.gossip import Gossip
from scenefold.peer.membership.removal import Evidence, removal_veto, silence_needed_s
from scenefold.peer.membership.roster import Roster
from scenefold.peer.membership.status import OwnStatus
from scenefold.peer.membership.suspicion import PROBES_MAX, PROPOSE_LATER_S, PROPOSE_SPREAD_S, Cause, Suspect, Suspicion
from scenefold.peer.membership.waking import Waking
from scenefold.peer.peers import Peers
from scenefold.peer.settings import NodeSettings
from scenefold.wire import Member, Packet, ProbeFor, ProbeResult, RemoveNode
from scenefold.world import Priority, World
from scenefold.world.buckets import Buckets

LOOK_S = 1.0
"""Between two looks at who has fallen silent."""
HELPERS = 2
"""Others that are asked to probe for us."""
HELP_S_MAX = 5.0
"""For another node to probe and answer: its probe takes 2 s."""
PROPOSE_S_MAX = 15.0
"""For the voter to judge a removal: it probes for itself."""
REQUESTED_MAX = 64
"""Probes for others at a time; more are refused."""
REQUESTED_BURST = 2 * PROBES_MAX
"""Probes that one node may ask for at once: whoever could ask for any number would use up what a third one is ready to sign."""
REQUESTED_PER_S = float(PROBES_MAX)
NONCE_BYTES = 16

_log = logging.getLogger("scenefold.peer.membership.probing")


class Verdict(Enum):
    """What others say of a peer that does not answer us."""

    HEARD = auto()
    NOT_HEARD = auto()
    NOBODY_ANSWERED = auto()


async def heard_by_others(peers: Peers, helpers: Sequence[NodeId], question: ProbeFor, is_right: Callable[[bytes], bool]) -> Verdict:
    """The indirect probe: ask all `helpers` at once, and believe a proof that `is_right`. NOT_HEARD if there is no helper to ask."""
    answers: list[bool] = []

    async def ask(helper: NodeId) -> None:
        try:
            answer = await peers.ask(helper, Priority.HIGH, question, ProbeResult, HELP_S_MAX)
        except (Unreachable, Refused, PeerFault) as problem:
            _log.debug("%s did not probe %s for us: %s", address_of(helper), address_of(question.target.node), problem)
        else:
            answers.append(is_right(answer.proof))

    async with trio.open_nursery() as nursery:
        for helper in helpers:
            nursery.start_soon(ask, helper)
    if any(answers):
        return Verdict.HEARD
    return Verdict.NOT_HEARD if answers or not helpers else Verdict.NOBODY_ANSWERED


class Probing:
    """Suspects, probes, proposes removals; answers ProbeFor; is the voter's ear when a removal is proposed to it."""

    def __init__(
        self,
        world: World,
        gossip: Gossip,
        roster: Roster,
        peers: Peers,
        cluster_log: ClusterLog,
        own: OwnStatus,
        settings: NodeSettings,
    ) -> None:
        self._world = world
        self._gossip = gossip
        self._roster = roster
        self._peers = peers
        self._cluster_log = cluster_log
        self._own = own
        self._remove_after_s = settings.remove_after_s
        self._asked: dict[NodeId, _Probe] = {}
        self._requested = 0
        self._requests = Buckets(REQUESTED_BURST, REQUESTED_PER_S)
        self.suspicion = Suspicion(settings.remove_after_s)
        self._waking = Waking(world.clock)

    def register(self, handlers: Handlers) -> None:
        handlers.add(ProbeFor, self._on_probe_for, senders=Senders.NODES)

    async def run(self, *, task_status: trio.TaskStatus[None] = trio.TASK_STATUS_IGNORED) -> None:
        """Watch until cancelled. Gossip must run."""
        async with trio.open_nursery() as nursery:
            nursery.start_soon(self._tell_removals)
            task_status.started()
            while True:
                await self._world.clock.sleep(LOOK_S)
                now = self._world.clock.now()
                self._waking.since()
                self.suspicion.review(self._signs_of, now)
                self._look(now)
                for suspect in self.suspicion.turn(now):
                    nursery.start_soon(self._examine, suspect)
                for suspect in self.suspicion.to_propose(self._proof_at, now):
                    nursery.start_soon(self._propose, suspect)

    async def veto(self, member: Member) -> str | None:
        """Why this voter does not want a member removed; None if it does not object. Takes up to 2 s: it probes."""
        objection = self.objection(member)
        if objection is None and await self._probe(member.node):
            objection = "it answered the voter's own probe"
        return objection or self.objection(member)

    # ------------------------------------------------------------------------------------------------- suspecting

    def _look(self, now: float) -> None:
        """Suspect whoever there is a cause for."""
        causes = (
            (Cause.LEASE_LAPSED, self._cluster_log.lapsed()),
            (Cause.REQUEST_FAILED, self._roster.refused()),
            (Cause.UNLIKELY, self._roster.silent()),
        )
        voters = self._cluster_log.registry.voters
        for cause, nodes in causes:
            for node in nodes:
                if not self._roster.is_peer(node) or node in voters:
                    continue
                if self.suspicion.suspect(self._member(node), cause, self._roster.signs(node), now):
                    _log.debug("%s is suspected: %s", address_of(node), cause.value)

    async def _examine(self, suspect: Suspect) -> None:
        if await self._probe(suspect.node):
            self.suspicion.heard(suspect, self._world.clock.now())
            return
        helpers = self._helpers(suspect)
        question = ProbeFor(target=suspect.member, nonce=self._world.entropy.token(NONCE_BYTES))
        is_right = partial(self._gossip.proofs.is_right, suspect.member, question.nonce)
        verdict = await heard_by_others(self._peers, helpers, question, is_right)
        now = self._world.clock.now()
        match verdict:
            case Verdict.HEARD:
                self._roster.vouch(suspect.node, now)
                self.suspicion.heard(suspect, now)
                _log.info("%s does not answer us, but others hear it", address_of(suspect.node))
            case Verdict.NOT_HEARD:
                if suspect.silent_at is None:
                    _log.info("%s is silent: %s", address_of(suspect.node), suspect.cause.value)
                self.suspicion.nobody_hears(suspect, tuple(helpers), self._hold_back_s(suspect.member), now)
            case Verdict.NOBODY_ANSWERED:
                self.suspicion.nobody_to_ask(suspect, now)

    async def _propose(self, suspect: Suspect) -> None:
        clock = self._world.clock
        moment = datetime.datetime.fromtimestamp(clock.wall(), datetime.UTC)
        reason = suspect.reason(self._own.me, clock.now() - self._proof_at(suspect), moment)
        _log.info("the removal of %s is proposed: %s", address_of(suspect.node), reason)
        try:
            with trio.fail_after(PROPOSE_S_MAX):
                await self._cluster_log.propose(RemoveNode(suspect.member, reason))
        except (Unreachable, Refused, PeerFault, trio.TooSlowError) as problem:
            _log.info("the removal of %s was not committed: %s", address_of(suspect.node), problem)
            self.suspicion.refused(suspect, self._world.clock.now())

    async def _tell_removals(self) -> None:
        """Say on every node who was removed, and why; when, says the line."""
        registry: Registry = self._cluster_log.registry
        while True:
            before = registry.position
            registry = await self._cluster_log.changed_after(before)
            for removal in registry.removed.values():
                if removal.position > before:
                    node = address_of(removal.member.node)
                    _log.info("%s was removed at position %d of the cluster's log: %s", node, removal.position, removal.reason)

    def _hold_back_s(self, member: Member) -> float:
        if self._own.me in self._cluster_log.registry.voters:
            return 0.0
        by_chance_s = self._world.entropy.uniform() * PROPOSE_SPREAD_S * self._roster.count
        return silence_needed_s(member, self._remove_after_s) + PROPOSE_LATER_S + by_chance_s

    def _helpers(self, suspect: Suspect) -> list[NodeId]:
        """Who is to probe for us, by chance, those first who were not asked yet."""
        candidates = [node for node in self._roster.alive() if node not in (self._own.me, suspect.node)]
        fresh = [node for node in candidates if node not in suspect.asked]
        if len(fresh) >= HELPERS:
            candidates = fresh
        chosen: list[NodeId] = []
        while candidates and len(chosen) < HELPERS:
            chosen.append(candidates.pop(int(self._world.entropy.uniform() * len(candidates))))
        return chosen

    # --------------------------------------------------------------------------------------------------- evidence

    def _member(self, node: NodeId) -> Member:
        return Member(node, self._roster.incarnation(node) or NO_INCARNATION)

    def _signs_of(self, member: Member) -> int | None:
        """Signs of life of a member; None if it is one no longer."""
        return self._roster.signs(member.node) if self._roster.is_peer(member.node) and self._member(member.node) == member else None

    def _proof_at(self, suspect: Suspect) -> float:
        return self._proof_of(suspect.member)

    def _proof_of(self, member: Member) -> float:
        known = self._roster.proof_at(member.node)
        # A founder without an incarnation has no status that could count: that it speaks at all is proof.
        met = self._gossip.met_at(member.node) if member.incarnation == NO_INCARNATION else None
        return max(value for value in (known, met, self._waking.since()) if value is not None)

    def objection(self, member: Member) -> str | None:
        """What this node, as a voter, knows against a removal, without asking anybody."""
        now = self._world.clock.now()
        evidence = Evidence(
            is_voter=member.node in self._cluster_log.registry.voters,
            proof_at=self._proof_of(member),
            leased_at=self._cluster_log.leased_at(member.node),
            members=self._roster.count,
            members_proven=self._roster.count_proven(now - self._remove_after_s),
        )
        return removal_veto(member, evidence, self._remove_after_s, now)

    # ----------------------------------------------------------------------------------------------------- probes

    async def _probe(self, target: NodeId) -> bool:
        """Probe a node directly; who asks for the same node meanwhile shares the answer."""
        running = self._asked.get(target)
        if running is not None:
            await running.over.wait()
            return running.heard
        probe = self._asked[target] = _Probe()
        try:
            probe.heard = await self._gossip.probe(target)
        finally:
            del self._asked[target]
            probe.over.set()
        return probe.heard

    async def _on_probe_for(self, packet: ProbeFor, peer: str) -> Packet:
        node = packet.target.node
        if node != self._own.me and not self._roster.is_peer(node):
            raise Refused(RejectReason.NOT_AUTHORISED, f"{address_of(node)} is no member as far as is known here")
        if self._requested >= REQUESTED_MAX or not self._requests.take(peer, self._world.clock.now()):
            raise Refused(RejectReason.BUSY, "too many probes are under way here")
        self._requested += 1
        try:
            return ProbeResult(target=packet.target, proof=await self._gossip.proofs.ask(packet.target, packet.nonce))
        finally:
            self._requested -= 1


class _Probe:
    """A probe under way."""

    def __init__(self) -> None:
        self.over = trio.Event()
        self.heard = False
