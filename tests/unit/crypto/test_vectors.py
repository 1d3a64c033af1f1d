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
    PublicKey,
    Record,
    SealingKey,
    SigningKey,
    open_record,
    parse_datagram,
    seal_record,
    sign_datagram,
    verify_datagram,
    verify_record,
)

VECTORS = json.loads((Path(__file__).resolve().parents[3] / "specs" / "vectors" / "records.json").read_text(encoding="utf-8"))


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


@pytest.mark.parametrize("entry", VECTORS["datagrams"], ids=lambda entry: entry["what"])
def test_datagrams(entry: dict[str, Any]) -> None:
    key = SigningKey.from_seed(bytes.fromhex(entry["seed"]))
    payload = bytes.fromhex(entry["payload"])
    data = sign_datagram(key, NodeId(entry["sender"]), entry["counter"], payload, target=NodeId(entry["target"]))
    assert data.hex() == entry["bytes"]
    assert verify_datagram(parse_datagram(data), key.public) == payload
