"""Writes specs/vectors/cluster_log.json: how a cluster's log goes on from its key to votes (specs/15-cluster-log.md, Voters).

    .venv/bin/python tools/make_cluster_vectors.py

The records that the log's key signed, the last of which names the first voter; and what voters decided behind it, with certificates. The
inputs are fixed and signatures deterministic, so the file changes only when the format does.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from scenefold.base.ids import NodeId, address_of
from scenefold.consensus.facts import signed
from scenefold.crypto import LOG_DOMAIN, SealingKey, SigningKey
from scenefold.peer.cluster_log.cluster_judge import ClusterJudge, value_of
from scenefold.peer.cluster_log.registry import Registry
from scenefold.wire import (
    AddNode,
    AddParticipant,
    Ballot,
    Found,
    Founder,
    LogEntry,
    LogRecord,
    Member,
    RemoveNode,
    RemoveParticipant,
    SignedRecord,
    Trust,
    Vote,
    pack_log,
)

TARGET = Path(__file__).parents[1] / "specs" / "vectors" / "cluster_log.json"
GENESIS = bytes(range(32))
LOG_KEY = SigningKey.from_seed(bytes(range(32, 64)))
NODES = (NodeId(0x7F000002), NodeId(0x7F000003), NodeId(0x7F000004))
FIRST, SECOND, THIRD = NODES


def document() -> dict[str, Any]:
    """The file's content."""
    registry, records, decided = Registry(), list[SignedRecord](), list[dict[str, Any]]()
    for entry in by_key():
        record = record_of(registry, entry)
        records.append(SignedRecord(record.encode(), LOG_KEY.sign(LOG_DOMAIN, record.encode())))
        registry = registry.apply(record)
    for entry in by_votes():
        judge = ClusterJudge(registry)
        row, registry = _decided(judge, entry)
        decided.append(row)
    return {
        "genesis": GENESIS.hex(),
        "log_key": LOG_KEY.public.raw.hex(),
        "seeds": {str(node): key_of(node).seed.hex() for node in NODES},
        "by_key": pack_log(records).hex(),
        "decided": decided,
    }


def by_key() -> list[LogEntry]:
    founders = tuple(Founder(node, key_of(node).public.raw, sealing_key_of(node), address_of(node)) for node in NODES)
    added = [AddNode(member_of(node), key_of(node).public.raw, sealing_key_of(node), address_of(node), NodeId(0)) for node in NODES]
    return [Found(founders, (FIRST,)), *added, *(Trust(node, True, sealing_key_of(node)) for node in NODES[1:]), named(FIRST)]


def by_votes() -> list[LogEntry]:
    """Two more vote; then the first one votes no more, and leaves the line."""
    first = member_of(FIRST)
    return [named(SECOND), named(THIRD), RemoveParticipant(first), RemoveNode(first, "its disk is worn out")]


def named(node: NodeId) -> AddParticipant:
    return AddParticipant(member_of(node), key_of(node).public.raw)


def key_of(node: NodeId) -> SigningKey:
    return SigningKey.from_seed(node.to_bytes(32, "little"))


def sealing_key_of(node: NodeId) -> bytes:
    return SealingKey(node.to_bytes(32, "big")).public.raw


def member_of(node: NodeId) -> Member:
    return Member(node, node.to_bytes(16, "little"))


def record_of(registry: Registry, entry: LogEntry) -> LogRecord:
    position = registry.position + 1
    return LogRecord(position, registry.head, position.to_bytes(16, "big"), FIRST, entry)


def _decided(judge: ClusterJudge, entry: LogEntry) -> tuple[dict[str, Any], Registry]:
    """By as many voters as are needed, those with the highest ids."""
    record = record_of(judge.registry, entry)
    value, voters = value_of(record), judge.participants
    assert judge.refuses(value) is None
    ballot = Ballot(record.position, FIRST)
    enough = [one.member for one in voters.everyone][-voters.majority :]
    votes = [signed(Vote(record.position, ballot, value.digest, who), GENESIS, key_of(who.node)) for who in enough]
    row = {
        "position": record.position,
        "voters": [[who.member.node, who.member.incarnation.hex()] for who in voters.everyone],
        "digest": value.digest.hex(),
        "data": value.data.hex(),
        "ballot": [ballot.counter, ballot.node],
        "votes": [[vote.member.node, vote.signature.hex()] for vote in votes],
    }
    return row, judge.after(value).registry


def main() -> None:
    TARGET.write_text(json.dumps(document(), indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
