"""May this be the cluster's log's next position, and who decides the one after it? (specs/15-cluster-log.md, Voters.) Pure.

A value is a record, whole: its digest is the hash that the next record's `prev_hash` names, so votes and chain speak of the same thing.
What needs a clock, or the authority's certificate, is judged by the voter that proposes (log_rules.py), and by nobody here: all who know the
same log say the same.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

from scenefold.base.errors import Refused
from scenefold.base.reasons import RejectReason
from scenefold.consensus.participants import Participants
from scenefold.consensus.values import Value
from scenefold.peer.cluster_log.log_rules import check_by_log, committed_at
from scenefold.peer.cluster_log.registry import Registry
from scenefold.wire import LogRecord, MalformedPacket

_REMEMBERED_MAX = 16
"""What a value makes of a log: it is judged by who votes, and again by who decides."""


def value_of(record: LogRecord) -> Value:
    """The value that is this record."""
    return Value(record.encode())


def record_in(value: Value) -> LogRecord:
    """The record that a value is; MalformedPacket if it is none."""
    return LogRecord.decode(value.data)


@dataclass(frozen=True, slots=True)
class ClusterJudge:
    """The log as of a position from which on votes decide."""

    registry: Registry = field(repr=False)

    def __post_init__(self) -> None:
        assert self.registry.voting.councils, "the log's key decides"

    @property
    def participants(self) -> Participants:
        return self.registry.voting.councils[-1].voters

    def refuses(self, value: Value, *, is_decided: bool = False) -> RejectReason | None:
        """`is_decided` changes nothing: a record lacks nothing."""
        try:
            _followed(self.registry, value.data, value.body)
        except Refused as refused:
            return refused.reason
        return None

    def found(self, value: Value) -> int | None:
        try:
            record = record_in(value)
            return committed_at(record.entry, record.request_id, self.registry)
        except (MalformedPacket, Refused):
            return None

    def after(self, value: Value) -> ClusterJudge:
        return ClusterJudge(_followed(self.registry, value.data, value.body))


@lru_cache(_REMEMBERED_MAX)
def _followed(registry: Registry, data: bytes, body: bytes) -> Registry:
    """The log with one more record; Refused if it is none that fits."""
    try:
        record = LogRecord.decode(data)
    except MalformedPacket as problem:
        raise _ill_formed(str(problem)) from problem
    if body:
        raise _ill_formed("a record is a value by itself, and brings nothing besides")
    if record.position != registry.position + 1:
        raise _ill_formed(f"the record is not one for position {registry.position + 1}")
    after = registry.apply(record)
    check_by_log(record.entry, record.origin, registry)
    return after


def _ill_formed(what: str) -> Refused:
    return Refused(RejectReason.ILL_FORMED, what, where="the cluster's log")
