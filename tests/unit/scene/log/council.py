"""A scene whose log participants decide, from its birth on: what Story is to one that its origin decides."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

from scenefold.base.ids import NodeId
from scenefold.client.births import first_header, first_private, first_records
from scenefold.crypto import SigningKey
from scenefold.peer.scene_log.headers import checked_header
from scenefold.scene.log import Followed, OpenedLog, SceneLog, decided, decided_by_votes, deciders_after, follow, value_of
from scenefold.wire import AddParticipant, Ballot, LogEntry, LogValue, Member, ParticipantEntry, RemoveParticipant, SceneLogPublic, Vote
from unit.scene.log.members import MAKER, secrets_of
from unit.scene.log.test_grants import KEEPER_KEY, MAKER_NUMBER, ORIGIN, Story

BALLOT = Ballot(1, NodeId(1))


@lru_cache(None)
def key_of(node: int, life: int = 0) -> SigningKey:
    return SigningKey(bytes([life + 1, *node.to_bytes(4, "big")]).rjust(32, b"n"))


@lru_cache(None)
def node(number: int, life: int = 0) -> ParticipantEntry:
    """A node that may take part."""
    return ParticipantEntry(Member(NodeId(number), life.to_bytes(16, "big")), key_of(number, life).public.raw)


def added(number: int, life: int = 0) -> AddParticipant:
    entry = node(number, life)
    return AddParticipant(entry.member, entry.key)


def removed(number: int, life: int = 0) -> RemoveParticipant:
    return RemoveParticipant(node(number, life).member)


def vote(entry: ParticipantEntry, value: LogValue, position: int, genesis: bytes, ballot: Ballot) -> Vote:
    """A participant's, signed; its key follows from node and incarnation."""
    unsigned = Vote(position, ballot, value.digest, entry.member)
    key = key_of(entry.member.node, int.from_bytes(entry.member.incarnation, "big"))
    return Vote(position, ballot, value.digest, entry.member, key.sign(Vote.DOMAIN, unsigned.signable(genesis)))


@dataclass
class Council(Story):
    first: tuple[int, ...] = (1, 2, 3)
    headers: list[SceneLogPublic] = field(default_factory=list)
    """All that were decided."""

    def __post_init__(self) -> None:
        super().__post_init__()
        first = [node(number) for number in self.first]
        header = first_header(self.kept, self.keys, MAKER, ORIGIN, first)
        assert header is not None
        self.header, self.private = decided(header, KEEPER_KEY), first_private(self.keys, MAKER, ORIGIN, first)
        records = first_records(self.keys, MAKER, ORIGIN, first)
        self.log = OpenedLog(SceneLog.of(one.decoded() for one in records), records)
        self.known = checked_header(self.header, None)
        self.headers.append(self.header)

    def offer(self, entry: LogEntry) -> Followed:
        """What an owner would propose next."""
        record = self.state.next_record(entry, self.token(16), ORIGIN.node)
        return follow(self.header, self.log, record, self.keys, secrets_of(MAKER_NUMBER).signing, self.token).sealed()

    def value(self, offered: Followed) -> LogValue:
        return value_of(offered.header, offered.private, self.header)

    def votes(self, value: LogValue, ballot: Ballot) -> list[Vote]:
        """Of all who decide the next position."""
        return [vote(entry, value, self.header.position + 1, self.header.genesis, ballot) for entry in deciders_after(self.header)]

    def decide(self, entry: LogEntry, ballot: Ballot = BALLOT) -> SceneLogPublic:
        """It is proposed, and decided by all."""
        return self.settle(self.offer(entry), ballot)

    def settle(self, offered: Followed, ballot: Ballot = BALLOT) -> SceneLogPublic:
        """It is decided by all, and believed by nodes that have followed, and by others."""
        header = decided_by_votes(offered.header, self.header, ballot, self.votes(self.value(offered), ballot))
        self.header, self.log, self.keys, self.private = header, offered.log, offered.keys, offered.private
        self.known = checked_header(self.header, self.known)
        assert checked_header(self.header, None).public == self.header
        self.headers.append(self.header)
        return self.header
