"""If this fails, a cluster's log that voters have decided counts no more, or counts for something else."""

from __future__ import annotations

import json
from typing import Any

from make_cluster_vectors import LOG_KEY, TARGET, document

from scenefold.consensus import Certificate, Value
from scenefold.peer.cluster_log.cluster_judge import ClusterJudge
from scenefold.peer.cluster_log.log_book import verified
from scenefold.peer.cluster_log.registry import Registry
from scenefold.wire import Ballot, Vote, unpack_log

GOLDEN: dict[str, Any] = json.loads(TARGET.read_text(encoding="utf-8"))


def test_the_golden_log_is_what_we_make() -> None:
    assert document() == GOLDEN


def test_who_reads_the_golden_log_comes_to_the_voters_that_it_names() -> None:
    registry, fresh = verified(Registry(), unpack_log(bytes.fromhex(GOLDEN["by_key"])), LOG_KEY.public)
    assert fresh and registry.voting.certified_from == registry.position
    judge = ClusterJudge(registry)
    for row in GOLDEN["decided"]:
        assert [[who.member.node, who.member.incarnation.hex()] for who in judge.participants.everyone] == row["voters"]
        value, who = Value(bytes.fromhex(row["data"])), {one.member.node: one.member for one in judge.participants.everyone}
        position, ballot = row["position"], Ballot(*row["ballot"])
        votes = tuple(Vote(position, ballot, value.digest, who[node], bytes.fromhex(signature)) for node, signature in row["votes"])
        assert value.digest.hex() == row["digest"] and position == judge.registry.position + 1
        assert Certificate(position, ballot, votes).proves(value, bytes.fromhex(GOLDEN["genesis"]), judge.participants)
        assert judge.refuses(value, is_decided=True) is None
        judge = judge.after(value)
