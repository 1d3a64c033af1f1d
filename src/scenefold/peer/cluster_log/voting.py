"""What a node does about the cluster's log once votes decide it (specs/26-modes.md, The cluster's log): it learns it and tells it; as a voter
it has entries decided, grants leases, hears the lives of those who voted before, and tells its own."""

from __future__ import annotations

import logging
from functools import partial

import trio

from scenefold.base.errors import DamagedData, PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.base.reasons import RejectReason
from scenefold.consensus.packets import messages_of
from scenefold.peer.cluster_log.elector import Elector
from scenefold.peer.cluster_log.held_notes import pack_page, unpack_page
from scenefold.peer.cluster_log.lease_grants import Question
from scenefold.peer.cluster_log.lease_questions import packet_of, question_in
from scenefold.peer.cluster_log.log_packets import GRANT
from scenefold.peer.cluster_log.voted_log import Ports, VotedLog
from scenefold.peer.membership.status import OwnStatus
from scenefold.peer.peers import Peers
from scenefold.peer.timing import LEASE_ASK_S_MAX, LOG_ASK_S_MAX, PROPOSE_RETRY_S
from scenefold.store import Store
from scenefold.wire import DecidedLog, Member, RequestSceneLog, RespondSceneLog, SceneLogAnswer, SceneLogPublic, Want
from scenefold.world import Priority, QuietLog, World
from scenefold.world.facts import ClusterFacts

LIVES_ASK_S_MAX = 5.0
"""For a voter to tell all lives that it holds: 32 KiB at most."""
BEHIND_MAX = 64
"""Positions that a new voter may lack: it learns them while it hears lives."""

_log = logging.getLogger("scenefold.peer.cluster_log.cluster_log")


class Voting:
    """Made at every node. `voted` is opened once the log's key has given way."""

    def __init__(self, world: World, store: Store, peers: Peers, facts: ClusterFacts, own: OwnStatus, ports: Ports) -> None:
        self._world, self._peers, self._own, self._ports = world, peers, own, ports
        self._scene, self._genesis = facts.genesis_header.scene, facts.genesis_header.genesis
        self.voted = VotedLog(world, store, own, ports, self._genesis)
        self.elector = Elector(world, facts, own.me, self.voted)
        self.elector.answers = self._answers
        self._quiet = QuietLog(_log, logging.INFO)

    @property
    def is_open(self) -> bool:
        return self.voted.opened.is_set()

    @property
    def is_ready(self) -> bool:
        """Whether this node votes, and grants leases."""
        return self.voted.is_voter and self.voted.desk.may_vote(changes_voters=True)

    @property
    def grants_leases(self) -> bool:
        """Whether this node decides, and may grant leases as one of those who do."""
        return self.is_ready and self.voted.desk.is_awake

    @property
    def is_restored(self) -> bool:
        """Another voter knows of a later life of this one, which has not spoken yet, so that its disk is an older one."""
        return self.voted.is_voter and self.voted.desk.is_restored

    async def run(self) -> None:
        """Until cancelled, once it is open."""
        async with trio.open_nursery() as nursery:
            await nursery.start(self.voted.run)
            nursery.start_soon(self._hear_lives)

    # ---------------------------------------------------------------------------------------------------- learning

    async def pull_from(self, node: NodeId) -> bool:
        """Take all that a node has; whether it answered with a log."""
        log = self.voted.log
        while True:
            have = log.position
            try:
                told = await self._told(node, have)
            except (Unreachable, Refused, PeerFault) as problem:
                _log.debug("the cluster's log is not told by %s: %s", address_of(node), problem)
                return False
            if told is None or told.genesis != self._genesis:
                return False
            for message in messages_of(RespondSceneLog(None, told)):
                log.receive(node, message)
            with trio.move_on_after(LOG_ASK_S_MAX):
                await self.voted.come_to(have + len(told.decided))
            if log.position == have or log.position >= told.newest:
                return not told.decided or log.position > have

    async def _told(self, node: NodeId, have: int) -> DecidedLog | None:
        """What a node has decided above a position."""
        packet = RequestSceneLog(self._scene, self._genesis, have, 0, Want.DECIDED)
        return (await self._peers.ask(node, Priority.HIGH, packet, RespondSceneLog, LOG_ASK_S_MAX)).decided

    async def _answers(self, node: NodeId) -> bool:
        try:
            told = await self._told(node, self.voted.log.position)
        except (Unreachable, Refused, PeerFault):
            return False
        return told is not None and told.genesis == self._genesis and told.newest + BEHIND_MAX >= self.voted.log.position

    async def on_decided(self, packet: RequestSceneLog, peer: str) -> RespondSceneLog | None:
        """5 (DECIDED): one that goes one way is a node's, for the log; the others are answered."""
        if packet.genesis not in (b"", self._genesis) or not self.is_open:
            return RespondSceneLog(answer=None) if packet.request_id else None
        if packet.request_id:
            return RespondSceneLog(None, await self.voted.page(packet.have))
        self._ports.intake.take(packet, peer)
        return None

    def on_push(self, packet: RespondSceneLog, peer: str) -> bool:
        """6 that tells decisions of this log; False if it is about another one."""
        if packet.decided is None or packet.decided.genesis != self._genesis:
            return False
        if self.is_open:
            self._ports.intake.take(packet, peer)
        return True

    # ------------------------------------------------------------------------------------------------------ leases

    async def on_lease(self, packet: RequestSceneLog, asker: NodeId) -> bool:
        """5 (LEASE): whether this voter grants it. Refused as by the rules of leases; 10 if this node is no voter."""
        question = question_in(packet, asker, self.voted.registry)
        if question is None:
            return False
        is_granted = await self.voted.desk.grant(question)
        if not is_granted and not self.voted.is_voter:
            raise Refused(RejectReason.NOT_MY_LOCATION, "owner leases are granted by voters")
        return is_granted

    async def ask_lease(self, voter: Member, question: Question) -> bool:
        """Whether a voter grants this; False: it has looked at the life, and does not. Refused, Unreachable, PeerFault."""
        packet = packet_of(question, self._scene, self._genesis, self._own.key)
        is_refused = False
        try:
            if voter == self._own.member:
                return await self.voted.desk.grant(question)
            answer = (await self._peers.ask(voter.node, Priority.HIGH, packet, RespondSceneLog, LEASE_ASK_S_MAX)).answer
            if answer is None or answer.nonce != question.nonce:
                raise PeerFault("a question for a lease was answered with something else", where=address_of(voter.node))
        except Refused as refusal:
            is_refused = refusal.reason is RejectReason.WRONG_INCARNATION
            if is_refused and voter != self._own.member:
                self.voted.desk.heard(voter, is_refused=True)
            raise
        self.voted.desk.heard(voter, is_refused=False)
        return bool(answer.flags & GRANT)

    # ------------------------------------------------------------------------------------------------------- lives

    def on_lives(self, packet: RequestSceneLog, asker: NodeId, header: SceneLogPublic) -> SceneLogAnswer:
        """5 (LIVES): all lives that this node holds, for one that votes since the change at `have`. Refused (12) to others; 16 if it cannot tell."""
        council = next((one for one in self.voted.registry.voting.councils if one.position == packet.have), None)
        if council is None:
            raise Refused(RejectReason.NOT_READY, "this node does not know yet that others vote from then on")
        if council.voters.member_of(asker) is None:
            raise Refused(RejectReason.NOT_AUTHORISED, "lives are told to who votes from then on")
        return SceneLogAnswer(packet.nonce, 0, packet.have, header, pack_page(self.voted.desk.tell(packet.have)))

    async def _hear_lives(self) -> None:
        """Have the lives of those who voted before, whenever this node votes anew."""
        desk = self.voted.desk
        while True:
            at, asked = desk.to_ask()
            if not asked:
                await desk.looked()
                continue
            async with trio.open_nursery() as nursery:
                for teller in asked:
                    nursery.start_soon(partial(self._hear_from, teller, at))
            if desk.to_ask()[1]:
                await self._world.clock.sleep(PROPOSE_RETRY_S)

    async def _hear_from(self, teller: Member, at: int) -> None:
        packet = RequestSceneLog(self._scene, self._genesis, at, 0, Want.LIVES)
        try:
            answer = (await self._peers.ask(teller.node, Priority.HIGH, packet, RespondSceneLog, LIVES_ASK_S_MAX)).answer
            if answer is None or answer.position != at or answer.private is None:
                raise PeerFault("a question for lives was answered with something else", where=address_of(teller.node))
            await self.voted.desk.told(teller, at, unpack_page(answer.private))
        except (Unreachable, Refused, PeerFault, DamagedData) as problem:
            if isinstance(problem, Refused) and problem.reason is RejectReason.NOT_READY:
                return
            text = f"{address_of(teller.node)} does not tell what it granted: {problem}"
            self._quiet.say(self._world.clock.now(), address_of(teller.node), "lives", text)
