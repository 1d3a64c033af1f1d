"""Nodes of which some decide the logs of scenes, each by what it knows itself: for tests of what a client makes of their answers.

How they agree is not played here: whoever is asked has a majority or not, and what it decides the others learn, or do not.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from scenefold.base.errors import NotReached
from scenefold.base.ids import NodeId, node_id_of
from scenefold.base.reasons import RejectReason
from scenefold.client.scenes import Scenes
from scenefold.crypto import LEASE_DOMAIN, PublicKey, SigningKey, key_id_of
from scenefold.peer.records.verification import KnownScene
from scenefold.peer.scene_log.proposals import accepted, answer_of, rejection
from scenefold.peer.scene_log.scene_judge import SceneJudge
from scenefold.scene.log import decided_by_votes, deciders_after, value_of, without_log
from scenefold.simulation.clients import secrets_of
from scenefold.wire import (
    Ballot,
    BorrowLease,
    DecidedLog,
    DecidedValue,
    Fault,
    LeaseUse,
    LentLease,
    Packet,
    ParticipantEntry,
    ProposeSceneLog,
    RequestSceneLog,
    RespondSceneLog,
    SceneLogPublic,
    SceneMode,
    Want,
)
from scenefold.world import Priority
from scenefold.world.keyring import Keyring
from scenefold.world.log_view import LogView, NodeKeys
from scenefold.world.roll import Roll
from unit.client.fake_nodes import ORIGIN, FakeNodes, PlainClock
from unit.scene.log.council import key_of, node, vote

PAGE = 2
"""Positions that are told at once."""
FIVE = tuple(f"127.0.0.{number}" for number in range(2, 7))
WRITER = SigningKey(bytes(31) + b"\1")

Answer = Callable[[str, ProposeSceneLog], Packet | None]
"""What a node does with a proposal in place of what is usual; None: as usual."""


@dataclass
class FakeCouncil(FakeNodes):
    addresses: tuple[str, ...] = FIVE
    trusted: tuple[str, ...] = FIVE
    has: dict[tuple[str, int], tuple[SceneLogPublic, bytes]] = field(default_factory=dict)
    """What each node knows of each scene, by its address."""
    deaf: set[str] = field(default_factory=set)
    """They learn nothing of what others decide."""
    without_log: set[str] = field(default_factory=set)
    """They take part, and have not got the sealed log yet."""
    answers: dict[str, Answer] = field(default_factory=dict)
    unlending: dict[str, RejectReason] = field(default_factory=dict)
    """Participants that lend nothing, and what they say."""
    asking_back: set[str] = field(default_factory=set)
    lent_ms: int = 12_000
    borrowed: list[tuple[str, BorrowLease]] = field(default_factory=list)
    """What was asked for, by signed questions, and of whom."""
    story: list[DecidedValue] = field(default_factory=list)
    """What was decided by votes, of the one scene of a test."""

    def view(self) -> LogView:
        """The cluster's log."""
        nodes = [node_id_of(address) for address in self.addresses]
        keys = {one: NodeKeys(key_of(one).public.raw, bytes(32)) for one in nodes}
        trusted = frozenset(map(node_id_of, self.trusted))
        return LogView(1, roll=Roll(trusted=trusted), nodes=keys, order=tuple(nodes), registered=dict.fromkeys(nodes, bytes(16)))

    async def newest_view(self) -> LogView:
        return self.view()

    def scenes(self, keyring: Keyring, writer: SigningKey = WRITER) -> Scenes:
        return Scenes(self.calls(), keyring, secrets_of(writer), ORIGIN, cluster_log=self.newest_view)

    def entry(self, node_id: NodeId) -> ParticipantEntry:
        """A node as a participant."""
        return node(node_id)

    def newest(self, scene: int) -> SceneLogPublic:
        """Of all nodes, whoever is away."""
        return max((header for (_, of), (header, _) in self.has.items() if of == scene), key=lambda header: header.position)

    async def request(self, address: str, priority: Priority, packet: Packet, timeout: float) -> Packet:
        if address in self.away:
            raise NotReached("nobody there", where=address)
        return await super().request(address, priority, packet, timeout)

    def _answer(self, address: str, packet: Packet) -> Packet:
        match packet:
            case RequestSceneLog(want=Want.DECIDED, genesis=genesis, have=have):
                page = tuple(one for one in self.story if one.position > have)[:PAGE]
                return RespondSceneLog(None, DecidedLog(genesis, len(self.story), page) if page else None)
            case RequestSceneLog() if (found := self.has.get((address, packet.scene))) is not None:
                header, private = found
                keeps = packet.want is Want.LOG and node_id_of(address) in _nodes(header) and address not in self.without_log
                return RespondSceneLog(answer_of(header, packet.nonce, private if keeps else None))
            case ProposeSceneLog():
                do = self.answers.get(address)
                done = None if do is None else do(address, packet)
                return self.propose(address, packet) if done is None else done
            case BorrowLease():
                return self.lend(address, packet)
            case _:
                return super()._answer(address, packet)

    def lend(self, address: str, packet: BorrowLease) -> Packet:
        """As a participant that has a lease if a majority is there; see `unlending`."""
        me, (header, _) = node_id_of(address), self.has[address, packet.scene]
        writer = next(PublicKey(entry.raw, entry.suite) for entry in header.keys if key_id_of(entry.raw) == packet.key)
        writer.verify(packet.signature, LEASE_DOMAIN, packet.signable())
        assert packet.lender == me in _nodes(header), "it is asked as who it is"
        assert packet.nonce > max([borrowed.nonce for lender, borrowed in self.borrowed if lender == address], default=0), "it rises"
        assert len({borrowed.process for _, borrowed in self.borrowed if borrowed.use is packet.use} | {packet.process}) == 1 or (
            packet.use is LeaseUse.GIVE_BACK
        ), "one for each use"
        self.borrowed.append((address, packet))
        if packet.use is LeaseUse.GIVE_BACK:
            return LentLease(packet.nonce, me, header.position, header.mode, True)
        alive = [node for node in _nodes(header) if not self._is_gone(node)]
        reason, wanted = self.unlending.get(address), SceneMode.RENDER if packet.use is LeaseUse.RENDER else SceneMode.EDIT
        if reason is None and (len(alive) <= len(header.participants) // 2 or header.mode is not wanted):
            reason = RejectReason.MODE_FORBIDS
        if reason is not None:
            return Fault(reason, "no lease")
        return LentLease(packet.nonce, me, header.position, header.mode, True, self.lent_ms, address in self.asking_back)

    def propose(self, address: str, packet: ProposeSceneLog) -> Packet:
        """As a node at its best."""
        known = self.has.get((address, packet.public.scene))
        if known is None or not known[0].participants:
            reply = self._propose(packet)
            if packet.public.scene in self.headers:
                self.tell(self.headers[packet.public.scene], self.logs[packet.public.scene])
            return reply
        return self._by_vote(address, packet, known[0])

    @staticmethod
    def clock_s() -> float:
        """The nodes' clocks."""
        return PlainClock().wall()

    def tell(self, header: SceneLogPublic, private: bytes) -> None:
        """To all that can hear it."""
        for address in self.addresses:
            if address not in self.away | self.deaf:
                self.has[address, header.scene] = header, private
        self.headers[header.scene], self.logs[header.scene] = header, private

    def _by_vote(self, address: str, packet: ProposeSceneLog, known: SceneLogPublic) -> Packet:
        me, public = node_id_of(address), packet.public
        if public == known.proposed():
            return accepted(known)
        if public.position <= known.position:
            return rejection(RejectReason.POSITION_TAKEN if public.position == known.position else RejectReason.POSITION_BEHIND, me)
        if me not in _nodes(known):
            return rejection(RejectReason.NOT_AUTHORISED, me)
        if public.position > known.position + 1:
            return rejection(RejectReason.BUSY, me)
        value = value_of(public, packet.private, known)
        refused = SceneJudge.of(KnownScene.of(known)).refuses(value)
        if refused is not None:
            return rejection(refused, me)
        alive = [entry for entry in deciders_after(known) if not self._is_gone(entry.member.node)]
        ballot = Ballot(1, me)
        if len(alive) <= len(known.participants) // 2:
            return rejection(RejectReason.NO_MAJORITY, me)
        votes = [vote(entry, value, public.position, public.genesis, ballot) for entry in alive]
        decided = decided_by_votes(public, known, ballot, votes)
        self.has[address, public.scene] = decided, packet.private
        seen = int(self.clock_s() * 1000)
        self.story.append(DecidedValue(public.position, without_log(value), ballot, tuple(votes), seen=seen))
        self.tell(decided, packet.private)
        return accepted(decided)

    def _is_gone(self, node_id: NodeId) -> bool:
        return any(node_id_of(address) == node_id for address in self.away)


def taking_part(*addresses: str) -> list[NodeId]:
    return [node_id_of(address) for address in addresses]


def _nodes(header: SceneLogPublic) -> set[NodeId]:
    return {entry.member.node for entry in deciders_after(header)}


def in_doubt(council: FakeCouncil, *, done: bool) -> Answer:
    """A node that has put what was proposed to the vote, and does not know what became of it; `done`: it was decided all the same."""

    def answer(address: str, packet: ProposeSceneLog) -> Packet:
        council.answers.pop(address)
        if done:
            council.propose(address, packet)
        return rejection(RejectReason.NOT_READY, node_id_of(address))

    return answer
