"""If this fails, what was signed or decided before counts no more, or counts for something else."""

from __future__ import annotations

import json
from typing import Any

import pytest
from make_consensus_vectors import TARGET, document

from scenefold.consensus import Value
from scenefold.crypto import SigningKey
from scenefold.peer.scene_log.headers import checked_header
from scenefold.scene.log import deciders_after, opened_value, value_of
from scenefold.wire import SceneLogPublic

GOLDEN: dict[str, Any] = json.loads(TARGET.read_text(encoding="utf-8"))


def test_the_golden_facts_and_certificates_are_what_we_make() -> None:
    assert document() == GOLDEN


@pytest.mark.parametrize("row", GOLDEN["facts"], ids=lambda row: row["kind"])
def test_a_golden_fact_is_true(row: dict[str, str]) -> None:
    key = SigningKey.from_seed(bytes.fromhex(row["seed"])).public
    assert row["signable"].startswith(GOLDEN["genesis"])
    key.verify(bytes.fromhex(row["signature"]), row["domain"].encode(), bytes.fromhex(row["signable"]))


def test_the_golden_headers_are_believed() -> None:
    scene = GOLDEN["scene"]
    first, second, third = (SceneLogPublic.decode(bytes.fromhex(data)) for data in scene["headers"])
    known = checked_header(first, None)
    for header in (second, third):
        assert checked_header(header, None).public == header
        known = checked_header(header, known)
    value = Value.decode(bytes.fromhex(scene["value"]["kept"]))
    assert value == value_of(third, opened_value(value).private, second)
    assert value.digest.hex() == scene["value"]["digest"]
    assert opened_value(value).public == third.proposed()
    assert [[one.member.node, one.member.incarnation.hex(), one.key.hex()] for one in deciders_after(third)] == scene["participants"]
