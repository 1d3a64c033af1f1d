"""How a scene's log came to be: each entry, and who decided it (specs/16-scene-log.md, A log's story). Pure.

The log itself is proven: the newest header was decided, and names the sealed log, whose records each name the one before. Who proposed and
accepted an entry, and when, is in no record: a participant shows it as it saw it, with the headers and the votes, which are verified.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from scenefold.base.errors import DamagedData
from scenefold.base.ids import KeyId, NodeId
from scenefold.consensus import Certificate, Participant, Participants
from scenefold.crypto import LOG_DOMAIN, PublicKey
from scenefold.scene.log import OpenedLog, Roster, deciders_after, opened_value
from scenefold.scene.log.values import data_of
from scenefold.wire import (
    AddObserver,
    AddParticipant,
    Batch,
    DecidedValue,
    LogEntry,
    LogRecord,
    LogValue,
    MalformedPacket,
    ParticipantEntry,
    RemoveObserver,
    RemoveParticipant,
    SceneLogPublic,
    digest_of_header,
)


@dataclass(frozen=True, slots=True)
class Vouched:
    """Who decided a position, as a participant shows it. `seen_ms`: when it learnt of it, by its clock, since 1970; 0: it does not know."""

    proposer: NodeId
    ballot: int
    voters: tuple[NodeId, ...]
    seen_ms: int

    @property
    def seen_s(self) -> float | None:
        return self.seen_ms / 1000 if self.seen_ms else None


@dataclass(frozen=True, slots=True)
class ToldEntry:
    """One position. `signed_by`: the header key in force there, which all owners have. `participants`: who could decide it; none if the origin
    did, alone. `vouched` None: nobody has shown who did."""

    record: LogRecord
    signed_by: KeyId
    participants: tuple[ParticipantEntry, ...]
    vouched: Vouched | None = None

    @property
    def position(self) -> int:
        return self.record.position


def told(header: SceneLogPublic, log: OpenedLog) -> list[ToldEntry]:
    """All records of a log that is the header's. DamagedData for one that is not signed by the key in force at its position.

    Whoever opens a log looks at the signatures of the newest key alone, for the chain holds the others; here all are looked at.
    """
    keys, roster = list(_keys(header)), log.beginning().roster
    entries = []
    for signed in log.records:
        record = signed.decoded()
        key = next(key for begins, key in reversed(keys) if begins <= record.position)
        key.verify(signed.signature, LOG_DOMAIN, signed.record)
        entries.append(ToldEntry(record, key.key_id, roster.participants))
        roster = _entered(roster, record.entry)
    return entries


def vouched(entries: Sequence[ToldEntry], header: SceneLogPublic, decided: Sequence[DecidedValue]) -> list[ToldEntry]:
    """With what a participant shows of who decided them. DamagedData unless headers and votes lead without a gap to the newest header."""
    found: dict[int, Vouched] = {}
    known = {entry.position: entry for entry in entries}
    expected, position = digest_of_header(header), header.position
    # Backwards, since each header names the one before, and the last one was decided as everybody sees.
    for one in reversed(decided):
        public = _public(one)
        if one.position != position or digest_of_header(public) != expected:
            raise _damaged(one, "another header was decided there")
        if (entry := known.get(position)) is not None and entry.participants:
            found[position] = _certified(one, public, entry)
        expected, position = public.previous, position - 1
    return [replace(entry, vouched=found.get(entry.position)) for entry in entries]


def _certified(one: DecidedValue, public: SceneLogPublic, entry: ToldEntry) -> Vouched:
    if public.request != entry.record.request_id:
        raise _damaged(one, "the log has another request there")
    data = data_of(entry.participants, deciders_after(public), digest_of_header(public))
    participants = Participants(tuple(Participant(one.member, PublicKey(one.key)) for one in entry.participants))
    if not Certificate(one.position, one.ballot, one.votes).proves(LogValue(data), public.genesis, participants):
        raise _damaged(one, "the votes are not those of a majority")
    voters = tuple(sorted({vote.member.node for vote in one.votes}))
    return Vouched(NodeId(one.ballot.node), one.ballot.counter, voters, one.seen)


def _public(one: DecidedValue) -> SceneLogPublic:
    try:
        public = opened_value(one.value).public
    except MalformedPacket as problem:
        raise _damaged(one, str(problem)) from problem
    if public.position != one.position:
        raise _damaged(one, "the header is of another position")
    return public


def _damaged(one: DecidedValue, why: str) -> DamagedData:
    return DamagedData(f"what a node shows of how the log was decided does not hold together: {why}", where=f"log position {one.position}")


def _keys(header: SceneLogPublic) -> Iterator[tuple[int, PublicKey]]:
    """The header keys by the positions from which on they sign; the first from 0."""
    yield 0, PublicKey(header.first_key)
    for step in header.succession:
        yield step.position, PublicKey(step.key)


def _entered(roster: Roster, entry: LogEntry) -> Roster:
    match entry:
        case Batch(entries):
            for one in entries:
                roster = _entered(roster, one)
            return roster
        case AddParticipant() | RemoveParticipant() | AddObserver() | RemoveObserver():
            return roster.entered(entry)
        case _:
            return roster
