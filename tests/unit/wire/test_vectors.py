"""If this fails, nodes of two versions would no longer understand each other."""

from __future__ import annotations

import json

import msgpack
import pytest

from scenefold.wire import LogRecord, decode_packet, encode_packet
from scenefold.wire.log_entries import LOG_ENTRY
from scenefold.wire.table import ROWS
from unit.wire.vectors import LOG_PATH, LONG, LONG_NUMBERS, PATH, example_packet, example_record, from_json

PACKETS = json.loads(PATH.read_text(encoding="utf-8"))
ENTRIES, LONG_ENTRIES = PACKETS["packets"], PACKETS[LONG]
RECORDS = json.loads(LOG_PATH.read_text(encoding="utf-8"))["records"]


def test_every_packet_has_a_vector() -> None:
    assert [(entry["number"], entry["name"]) for entry in ENTRIES] == [(number, ROWS[number].name) for number in sorted(ROWS)]


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry["name"])
def test_the_bytes_are_pinned(entry: dict[str, object]) -> None:
    data = bytes.fromhex(str(entry["bytes"]))
    assert msgpack.unpackb(data) == from_json(entry["array"])
    packet = decode_packet(data)
    assert packet == example_packet(ROWS[int(str(entry["number"]))].number)
    assert encode_packet(packet) == data


def test_what_rsa_keys_sign_has_vectors() -> None:
    assert [entry["number"] for entry in LONG_ENTRIES] == list(LONG_NUMBERS)


@pytest.mark.parametrize("entry", LONG_ENTRIES, ids=lambda entry: entry["name"])
def test_the_bytes_of_longer_signatures_are_pinned(entry: dict[str, object]) -> None:
    data = bytes.fromhex(str(entry["bytes"]))
    assert msgpack.unpackb(data) == from_json(entry["array"])
    packet = decode_packet(data)
    assert packet == example_packet(int(str(entry["number"])), is_long=True)
    assert encode_packet(packet) == data
    assert b"\xc5\x01\x80" in data, "a bin of 384 bytes"


def test_every_log_entry_has_a_vector() -> None:
    assert [(entry["number"], entry["name"]) for entry in RECORDS] == [(number, kind.name) for number, kind in LOG_ENTRY.structs.items()]


@pytest.mark.parametrize("entry", RECORDS, ids=lambda entry: entry["name"])
def test_the_bytes_and_hash_of_a_log_record_are_pinned(entry: dict[str, object]) -> None:
    data = bytes.fromhex(str(entry["bytes"]))
    assert msgpack.unpackb(data) == from_json(entry["array"])
    record = LogRecord.decode(data)
    assert record == example_record(int(str(entry["number"])))
    assert record.encode() == data
    assert record.hash().hex() == entry["hash"]
