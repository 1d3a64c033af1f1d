"""If this fails, logs that were written before cannot be read, or places of stored scenes mean something else than they did."""

from __future__ import annotations

import json
from typing import Any

from make_scene_log_vectors import TARGET, document

from house.sources import ROOT
from scenefold.client.births import verified_header_key
from scenefold.crypto import SealingKey, SigningKey
from scenefold.scene.log import SceneLog, check_granter, check_log, open_private, unlocked
from scenefold.wire import Decision, Lockbox, Role, SceneLogPublic, SignedSnapshot


def test_the_golden_log_is_what_we_make() -> None:
    assert document() == json.loads(TARGET.read_text(encoding="utf-8"))


def test_the_golden_log_is_read() -> None:
    golden = json.loads((ROOT / "specs" / "vectors" / "scene_log.json").read_text(encoding="utf-8"))
    header_key = SigningKey.from_seed(bytes.fromhex(golden["header_seed"])).public
    opened = open_private(
        bytes.fromhex(golden["sealed"]),
        genesis=bytes.fromhex(golden["genesis"]),
        position=len(golden["records"]),
        symmetric_key=bytes.fromhex(golden["symmetric_key"]),
        header_key=header_key,
    )
    log = opened.state
    assert [record.record.hex() for record in opened.records] == [row["record"] for row in golden["records"]]
    assert [(member.name, member.role) for member in log.grants.members] == [("user:m1", Role.OWNER)]
    assert (log.grants.key_epoch, log.write_floor) == (1, 6)
    assert log.head.hex() == golden["records"][-1]["hash"]
    for row in golden["places"]:
        space = log.space(row["space"])
        assert [float(number).hex() for number in space.transform.offset] == row["offset"]
        positions = [[float.fromhex(number) for number in point] for point in row["positions"]]
        assert [location.hex() for location in space.locations_of(positions)] == row["locations"]


def test_the_golden_log_with_a_snapshot_says_the_same() -> None:
    golden = json.loads(TARGET.read_text(encoding="utf-8"))
    told: dict[str, Any] = {
        "genesis": bytes.fromhex(golden["genesis"]),
        "position": len(golden["records"]),
        "symmetric_key": bytes.fromhex(golden["symmetric_key"]),
        "header_key": SigningKey.from_seed(bytes.fromhex(golden["header_seed"])).public,
    }
    whole, short = (open_private(bytes.fromhex(part["sealed"]), **told) for part in (golden, golden["shortened"]))
    assert short.state == whole.state
    assert short.records == whole.records[golden["shortened"]["position"] :]
    assert short.snapshot == SignedSnapshot(*(bytes.fromhex(golden["shortened"][part]) for part in ("state", "signature")))
    assert short.beginning() == SceneLog.of(record.decoded() for record in whole.records[: golden["shortened"]["position"]])


def test_the_golden_header_is_believed() -> None:
    golden = json.loads(TARGET.read_text(encoding="utf-8"))
    row = golden["header"]
    header = SceneLogPublic.decode(bytes.fromhex(row["bytes"]))
    assert verified_header_key(header).raw == header.first_key == bytes.fromhex(row["first_key"])
    assert (header.genesis.hex(), header.birth.hex(), header.log_hash.hex()) == (row["genesis"], row["birth"], row["log_hash"])
    assert header.origin_key == SigningKey.from_seed(bytes.fromhex(row["origin_seed"])).public.raw
    assert (header.signature.hex(), header.signable().hex()) == (row["signature"], row["signable"])
    assert header.decision == Decision(1, (bytes.fromhex(row["certificate"]),))
    check_log(header, bytes.fromhex(golden["sealed"]))


def test_the_golden_lockbox_is_opened() -> None:
    golden = json.loads(TARGET.read_text(encoding="utf-8"))
    row = golden["lockbox"]
    lockbox = Lockbox(row["recipient"], bytes.fromhex(row["sealed"]), bytes.fromhex(row["signature"]))
    found = unlocked(lockbox, SealingKey(bytes.fromhex(row["sealing_seed"])), bytes.fromhex(golden["genesis"]), row["key_epoch"])
    assert found.encode().hex() == row["contents"]
    check_granter(lockbox, found, bytes.fromhex(golden["genesis"]), SigningKey(bytes([1]) * 32).public)
    assert (found.symmetric_key.hex(), found.name) == (golden["symmetric_key"], "kitchen")
