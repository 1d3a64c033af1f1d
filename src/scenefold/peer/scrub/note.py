"""How far a scrub has come, as the bytes of the store's note, and back, strictly (specs/21-verify.md, Scrub). Pure."""

from __future__ import annotations

from typing import Any

from scenefold.base.errors import DamagedData
from scenefold.base.plain_values import whole
from scenefold.peer.scrub.pace import Round
from scenefold.store.checking.records import OBJECT_KEY_BYTES, PLACE_KEY_BYTES
from scenefold.wire import MalformedPacket, pack_value, unpack_value

NOTE = "scrub"
TOLD_MAX = 1_024
"""Rotten records of which word is left. Of more the node finds the rest as it reads."""
_VERSION = 1
_KEYS = {"after", "before", "bytes", "records", "rotten", "round", "told", "v"}
_NUMBER_MAX = (1 << 63) - 1


def encode_round(found: Round) -> bytes:
    return pack_value(
        {
            "v": _VERSION,
            "round": found.number,
            "after": found.after,
            "bytes": found.read_bytes,
            "records": found.records,
            "rotten": found.rotten,
            "before": found.rotten_before,
            "told": list(found.told),
        },
        what="scrub",
    )


def decode_round(note: bytes) -> Round:
    """DamagedData if the note is none that `encode_round` writes."""
    try:
        value = unpack_value(note)
        if not isinstance(value, dict) or value.get("v") != _VERSION or set(value) != _KEYS:
            raise ValueError("not the fields of a scrub")
        after, told = value["after"], value["told"]
        if not isinstance(told, list) or len(told) > TOLD_MAX:
            raise ValueError("more than is ever told")
        return Round(
            number=whole(value["round"], 1, _NUMBER_MAX),
            after=None if after is None else _key(after),
            read_bytes=whole(value["bytes"], 0, _NUMBER_MAX),
            records=whole(value["records"], 0, _NUMBER_MAX),
            rotten=whole(value["rotten"], 0, _NUMBER_MAX),
            rotten_before=whole(value["before"], 0, _NUMBER_MAX),
            told=tuple(map(_key, told)),
        )
    except (MalformedPacket, ValueError, TypeError) as problem:
        raise DamagedData("the note of how far the scrub has come is damaged", where=str(problem)) from problem


def _key(value: Any) -> bytes:
    if not isinstance(value, bytes) or len(value) not in (PLACE_KEY_BYTES, OBJECT_KEY_BYTES):
        raise ValueError("not the key of a record")
    return value
