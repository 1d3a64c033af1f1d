"""If this fails, nodes of two versions would no longer understand each other."""

from __future__ import annotations

import json

import msgpack
import pytest

from scenefold.wire import decode_packet, encode_packet
from scenefold.wire.table import ROWS
from unit.wire.vectors import PATH, example_packet, from_json

ENTRIES = json.loads(PATH.read_text(encoding="utf-8"))["packets"]


def test_every_packet_has_a_vector() -> None:
    assert [(entry["number"], entry["name"]) for entry in ENTRIES] == [(number, ROWS[number].name) for number in sorted(ROWS)]


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry["name"])
def test_the_bytes_are_pinned(entry: dict[str, object]) -> None:
    data = bytes.fromhex(str(entry["bytes"]))
    assert msgpack.unpackb(data) == from_json(entry["array"])
    packet = decode_packet(data)
    assert packet == example_packet(ROWS[int(str(entry["number"]))].number)
    assert encode_packet(packet) == data
