"""If this fails, records that were written by an earlier version, or another implementation, can no longer be read."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from scenefold.base.ids import NodeId, SceneId, SpaceId
from scenefold.base.location import Location
from scenefold.crypto import (
    ED25519,
    RSA3072,
    DatagramKey,
    PublicKey,
    Record,
    SealingKey,
    SigningKey,
    head_of,
    open_record,
    seal_record,
    verify_record,
)
from scenefold.crypto.datagrams import derived

FOLDER = Path(__file__).resolve().parents[3] / "specs" / "vectors"
VECTORS = json.loads((FOLDER / "records.json").read_text(encoding="utf-8"))
DATAGRAMS = json.loads((FOLDER / "datagrams.json").read_text(encoding="utf-8"))["datagrams"]


@pytest.mark.parametrize("entry", VECTORS["records"], ids=lambda entry: entry["what"])
def test_records(entry: dict[str, Any]) -> None:
    fields = entry["header"]
    suite = fields["suite"]
    key = SigningKey(entry["private_key"].encode(), suite) if suite == RSA3072 else SigningKey.from_seed(bytes.fromhex(entry["seed"]))
    symmetric_key = bytes.fromhex(entry["symmetric_key"])
    record = seal_record(
        bytes.fromhex(entry["payload"]),
        scene=SceneId(fields["scene"]),
        genesis=bytes.fromhex(fields["genesis"]),
        space=SpaceId(fields["space"]),
        location=Location.fromhex(fields["location"]),
        epoch=fields["epoch"],
        seq=fields["seq"],
        session=fields["session"],
        expects=bytes.fromhex(fields["expects"]),
        content_position=fields["content_position"],
        key_epoch=fields["key_epoch"],
        placement=fields["placement"],
        nonce=bytes.fromhex(fields["nonce"]),
        symmetric_key=symmetric_key,
        signing_key=key,
    )
    assert record.header_bytes.hex() == entry["header_bytes"]
    # An RSA signature has a salt.
    assert suite == RSA3072 or record.signature.hex() == entry["signature"]
    assert record.ciphertext.hex() == entry["ciphertext"]
    stored = Record.decode(bytes.fromhex(entry["header_bytes"] + entry["signature"] + entry["ciphertext"]))
    header = verify_record(stored, PublicKey(bytes.fromhex(entry["public_key"]), suite))
    assert header.writer == fields["writer"] == int(entry["key_id"], 16)
    assert open_record(stored, symmetric_key).hex() == entry["payload"]


@pytest.mark.parametrize("entry", VECTORS["sealings"], ids=lambda entry: entry["what"])
def test_sealings(entry: dict[str, Any]) -> None:
    suite, purpose = entry["suite"], entry["purpose"].encode()
    context, plaintext, sealed = (bytes.fromhex(entry[name]) for name in ("context", "plaintext", "sealed"))
    key = SealingKey.from_text(entry["private_key"].encode(), entry["what"])
    assert (key.suite, key.public.raw.hex(), f"{key.public.key_id:08x}") == (suite, entry["public_key"], entry["key_id"])
    assert key.open(sealed, purpose, context) == plaintext
    if suite == ED25519:
        assert key.public.seal(plaintext, purpose, context, lambda _: bytes.fromhex(entry["ephemeral"])) == sealed


@pytest.mark.parametrize("entry", DATAGRAMS, ids=lambda entry: entry["what"])
def test_datagrams(entry: dict[str, Any]) -> None:
    ends = [SealingKey(bytes.fromhex(entry[f"{end}_seed"])) for end in ("sender", "target")]
    assert [end.public.raw.hex() for end in ends] == [entry["sender_public"], entry["target_public"]]
    secret = ends[0].agree(ends[1].public)
    assert secret == ends[1].agree(ends[0].public) == bytes.fromhex(entry["secret"])
    assert derived(secret, bytes.fromhex(entry["salt"]), bytes.fromhex(entry["info"])).hex() == entry["key"]
    pair = NodeId(entry["sender"]), NodeId(entry["target"])
    key = DatagramKey(secret, bytes.fromhex(entry["cluster_id"]), entry["port"], *pair, bytes.fromhex(entry["salt"]))
    data = bytes.fromhex(entry["bytes"])
    assert key.seal(entry["counter"], bytes.fromhex(entry["content"])) == data
    assert head_of(data) == (*pair, bytes.fromhex(entry["salt"]), entry["counter"])
    assert key.open(data).hex() == entry["content"]
