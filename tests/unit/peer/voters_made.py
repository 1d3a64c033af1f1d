"""A cluster whose log voters decide, made by hand for tests: the records of the log's key, and what was voted for behind them."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass, field

from scenefold.consensus import Certificate, Value
from scenefold.consensus.facts import signed as signed_fact
from scenefold.peer.cluster_log.cluster_judge import ClusterJudge, value_of
from scenefold.peer.cluster_log.registry import Registry
from scenefold.wire import AddParticipant, Ballot, LogEntry, LogRecord, RemoveParticipant, SignedRecord, Trust, Vote
from unit.peer.logs_made import add, found, key_of, member, node, record, secrets_of, signed

GENESIS = bytes(range(32))
BALLOT = Ballot(3, node(0))


def named(number: int, life: int = 0) -> AddParticipant:
    return AddParticipant(member(number, life), key_of(number).public.raw)


def dismissed(number: int, life: int = 0) -> RemoveParticipant:
    return RemoveParticipant(member(number, life))


def trusted(number: int) -> Trust:
    """With the authority's key, so that it issues."""
    return Trust(node(number), True, secrets_of(number).sealing.public.raw, b"sealed to %d" % number)


@dataclass
class Senate:
    """Founders, all of them members and trusted, of whom the first one names itself, and then others follow by votes."""

    members: int = 5
    voters: int = 3
    records: list[SignedRecord] = field(default_factory=list)
    """Of the log's key."""
    decided: list[tuple[Value, Certificate]] = field(default_factory=list)
    """By votes."""
    registry: Registry = field(default_factory=Registry)

    def __post_init__(self) -> None:
        everyone = range(self.members)
        entries: list[LogEntry] = [found(self.members), *map(add, everyone), *map(trusted, everyone), named(0)]
        for entry in entries:
            self.by_key(entry)
        for number in range(1, self.voters):
            self.decide(named(number))

    @property
    def judge(self) -> ClusterJudge:
        return ClusterJudge(self.registry)

    def by_key(self, entry: LogEntry) -> None:
        written = record(self.registry, entry)
        self.records.append(signed(written))
        self.registry = self.registry.apply(written)

    def value(self, entry: LogEntry, origin: int = 0, request: bytes | None = None) -> Value:
        """What a voter makes of what a node asks for."""
        return value_of(self.record(entry, origin, request))

    def record(self, entry: LogEntry, origin: int = 0, request: bytes | None = None) -> LogRecord:
        return record(self.registry, entry, request, origin)

    def decide(self, entry: LogEntry, origin: int = 0) -> Value:
        """By all voters; a judge that refuses it is an error."""
        value, judge = self.value(entry, origin), self.judge
        assert judge.refuses(value) is None
        self.decided.append((value, self.certificate(value)))
        self.registry = judge.after(value).registry
        return value

    def certificate(self, value: Value, voters: Iterable[int] | None = None) -> Certificate:
        """The votes of these nodes, or of all voters."""
        position = self.registry.position + 1
        everyone = [one.member.node - node(0) for one in self.judge.participants.everyone] if voters is None else voters
        votes = [signed_fact(Vote(position, BALLOT, value.digest, member(one)), GENESIS, key_of(one)) for one in everyone]
        return Certificate(position, BALLOT, tuple(votes))


def request_of(what: str) -> bytes:
    return hashlib.sha256(what.encode()).digest()[:16]
