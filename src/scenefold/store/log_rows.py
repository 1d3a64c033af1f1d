"""What a node keeps of a log that several decide, as bytes (specs/10-store.md, Logs). Pure.

    genesis 32                  ->  1 u8 | incarnation 16 | open position u64 | silent until u64 | promised 8 | accepted ballot 8
                                    | count u16 | exposed digest 32, ascending, ... | size u32 | accepted value | CRC
    genesis 32 | position u64   ->  1 u8 | ballot 8 | count u8 | (node u32 | incarnation 16 | size u8 | signature), ... | size u32 | value | CRC

The first row is of the position that is open, the others are what is decided, each with its certificate. Rows that do not read as they
were written are no reason to stop the node: it does not vote in that log until it cannot contradict itself any more.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from scenefold.base.errors import DamagedData
from scenefold.base.ids import NodeId
from scenefold.base.limits import DECIDERS_MAX, LOG_EXPOSED_MAX, LOG_VALUE_BYTES_MAX
from scenefold.consensus import Certificate, Slot, Tentative, Value, Vote
from scenefold.store.layout import LOGS
from scenefold.store.sealing import StoreDamaged, opened, sealed
from scenefold.wire import Ballot, MalformedPacket, Member

GENESIS_BYTES = 32
_POSITION = struct.Struct(">Q")
POSITION_MAX = 2**64 - 1
_VERSION = 1
_VOTES = struct.Struct(">B16sQQIIIIH")
_SIZE = struct.Struct(">I")
_PROOF = struct.Struct(">BIIB")
_VOTE = struct.Struct(">I16sB")
_DIGEST_BYTES = 32
_SIGNATURE_BYTES_MAX = 64


class Votes(NamedTuple):
    """What this incarnation has promised and voted for at the open position.

    `silent_until`: at this position and below it does not vote, whatever it is asked, since it may have voted and forgotten it.
    """

    incarnation: bytes
    position: int
    slot: Slot = Slot()
    silent_until: int = 0


class Decided(NamedTuple):
    """What is decided at a position, and what shows that it is."""

    position: int
    value: Value
    certificate: Certificate


@dataclass(frozen=True, slots=True)
class StoredLog:
    """What is left on the disk of a log, from some position on. `tail` has no gaps.

    `silent_until`: this node must not vote there or below. `damage`: what has changed on the disk, for people.
    """

    tail: tuple[Decided, ...]
    slot: Slot
    silent_until: int = 0
    damage: tuple[str, ...] = field(default=())


def votes_key(genesis: bytes) -> bytes:
    assert len(genesis) == GENESIS_BYTES
    return genesis


def decided_key(genesis: bytes, position: int) -> bytes:
    assert len(genesis) == GENESIS_BYTES
    return genesis + _POSITION.pack(position)


def position_of(key: bytes) -> int | None:
    """The position of a decided row's key; 0 of the row of votes, None of a key that is neither."""
    if len(key) == GENESIS_BYTES:
        return 0
    return int(_POSITION.unpack(key[GENESIS_BYTES:])[0]) if len(key) == GENESIS_BYTES + _POSITION.size else None


def log_named(key: bytes) -> str:
    """A row's place, for people."""
    position = position_of(key)
    if position is None:
        return key.hex()
    log = f"log {key[:8].hex()}"
    return f"{log}, position {position}" if position else f"votes of {log}"


def pack_votes(genesis: bytes, votes: Votes) -> bytes:
    slot, accepted = votes.slot, votes.slot.accepted
    value = b"" if accepted is None else accepted.value.encode()
    exposed = sorted(slot.exposed)
    assert len(exposed) <= LOG_EXPOSED_MAX and len(value) <= LOG_VALUE_BYTES_MAX, "bounded before it comes here"
    ballots = (*_plain(slot.promised), *_plain(slot.accepted_ballot))
    head = _VOTES.pack(_VERSION, votes.incarnation, votes.position, votes.silent_until, *ballots, len(exposed))
    return sealed(LOGS, votes_key(genesis), b"".join((head, *exposed, _SIZE.pack(len(value)), value)))


def unpack_votes(genesis: bytes, stored: memoryview) -> Votes:
    """DamagedData if it is not what was written."""
    key = votes_key(genesis)
    reader = _Reader(key, stored)
    version, incarnation, position, silent_until, *numbers, count = reader.fields(_VOTES)
    promised, accepted = Ballot(numbers[0], NodeId(numbers[1])), Ballot(numbers[2], NodeId(numbers[3]))
    exposed = [reader.take(_DIGEST_BYTES) for _ in range(reader.bounded(count, LOG_EXPOSED_MAX))]
    value = reader.value()
    tentative = Tentative(accepted, reader.decoded(value)) if accepted != Slot().accepted_ballot else None
    slot = Slot(promised, tentative, frozenset(exposed))
    is_lawful = accepted <= promised and (tentative is not None or not value) and exposed == sorted(slot.exposed) and position > 0
    reader.end(lawful=version == _VERSION and is_lawful)
    return Votes(incarnation, position, slot, silent_until)


def pack_decided(genesis: bytes, decided: Decided) -> bytes:
    proof, value = decided.certificate, decided.value.encode()
    assert proof.position == decided.position and 1 <= len(proof.votes) <= DECIDERS_MAX and len(value) <= LOG_VALUE_BYTES_MAX
    parts = [_PROOF.pack(_VERSION, *_plain(proof.ballot), len(proof.votes))]
    for vote in proof.votes:
        parts += [_VOTE.pack(vote.member.node, vote.member.incarnation, len(vote.signature)), vote.signature]
    return sealed(LOGS, decided_key(genesis, decided.position), b"".join((*parts, _SIZE.pack(len(value)), value)))


def unpack_decided(key: bytes, stored: memoryview) -> Decided:
    """DamagedData if it is not what was written."""
    position = position_of(key)
    assert position, "the key of a decided row"
    reader = _Reader(key, stored)
    version, counter, node, count = reader.fields(_PROOF)
    ballot, signed = Ballot(counter, NodeId(node)), list[tuple[Member, bytes]]()
    for _ in range(reader.bounded(count, DECIDERS_MAX)):
        voter, incarnation, size = reader.fields(_VOTE)
        signed.append((Member(NodeId(voter), incarnation), reader.take(reader.bounded(size, _SIGNATURE_BYTES_MAX))))
    value = reader.decoded(reader.value())
    reader.end(lawful=version == _VERSION and count > 0)
    votes = tuple(Vote(position, ballot, value.digest, member, signature) for member, signature in signed)
    return Decided(position, value, Certificate(position, ballot, votes))


def _plain(ballot: Ballot) -> tuple[int, int]:
    return ballot.counter, ballot.node


class _Reader:
    """A row from its first byte to its last."""

    def __init__(self, key: bytes, stored: memoryview) -> None:
        self._key, self._at = key, 0
        try:
            self._data = bytes(opened(LOGS, key, stored))
        except StoreDamaged:
            raise self._damaged("have changed on the disk") from None

    def fields(self, layout: struct.Struct) -> tuple[Any, ...]:
        return layout.unpack(self.take(layout.size))

    def take(self, count: int) -> bytes:
        taken = self._data[self._at : self._at + count]
        if len(taken) < count:
            raise self._damaged("end too early")
        self._at += count
        return taken

    def value(self) -> bytes:
        return self.take(self.bounded(self.fields(_SIZE)[0], LOG_VALUE_BYTES_MAX))

    def decoded(self, data: bytes) -> Value:
        try:
            return Value.decode(data)
        except MalformedPacket:
            raise self._damaged("hold no value") from None

    def bounded(self, count: int, most: int) -> int:
        if count > most:
            raise self._damaged(f"name {count} where {most} are the most")
        return count

    def end(self, *, lawful: bool) -> None:
        if not lawful or self._at != len(self._data):
            raise self._damaged("are none")

    def _damaged(self, what: str) -> DamagedData:
        return DamagedData(f"the stored bytes {what}", where=log_named(self._key))
