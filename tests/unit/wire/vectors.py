"""Golden packets and log records: one example of each, made from the table, written to specs/vectors/.

The files pin the bytes: an entry is written once and, from the first release on, changes only when the protocol's
version does. To add what is new: `PYTHONPATH=tests .venv/bin/python -m unit.wire.vectors`; it keeps every entry that exists.
Where keys and signatures may be of either suite, "packets" has those of suite 1; "packets of suite 2" has some with the longer ones.

In the files bytes stand as {"bin": hexadecimal}; everything else as in JSON. "array" is the MessagePack array.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from scenefold.base.ids import NodeId
from scenefold.base.location import Location
from scenefold.wire import SceneMode, encode_packet
from scenefold.wire.common import DIGEST, INCARNATION, MINI_STATUS, Packet
from scenefold.wire.containers import Late, Many, Struct, Tagged
from scenefold.wire.kinds import Bin, Choice, Flag, Float, Kind, Maybe, Place, Text, Uint
from scenefold.wire.log_entries import LOG_ENTRY
from scenefold.wire.log_records import LOG_RECORD, LogRecord
from scenefold.wire.table import ROWS
from unit.wire.lawful import lawful

FOLDER = Path(__file__).resolve().parents[3] / "specs" / "vectors"
PATH = FOLDER / "packets.json"
LOG_PATH = FOLDER / "log.json"
LONG = "packets of suite 2"
LONG_NUMBERS = (6, 10, 14, 32)
"""A scene's header, and records."""
_LONG_BYTES = 384


def example(kind: Kind[Any], salt: int, *, is_long: bool = False) -> Any:
    """A value of this kind that uses its width: no two fields of a packet alike. `is_long`: keys and signatures are those of suite 2."""
    match kind:
        case Uint():
            return min(kind.most, kind.least + salt * 0x0123456789AB % (kind.most - kind.least + 1))
        case Choice():
            # What came later is none of the examples, so that these stay those that they are.
            members = [member for member in kind.members if member is not SceneMode.ENDED]
            return members[salt % len(members)]
        case Flag():
            return salt % 2 == 0
        case Float():
            return salt + 0.25
        case Bin():
            size = kind.lengths[-1 if kind.lengths[-1] <= 32 else 0] if kind.lengths else 5
            size = 64 if 64 in kind.lengths else size
            size = _LONG_BYTES if is_long and _LONG_BYTES in kind.lengths else size
            return bytes((salt + at) % 256 for at in range(size))
        case Text():
            return f"text {salt} é"
        case Place():
            return Location(bytes((salt * 7 + at) % 256 for at in range(20)))
        case Late():
            return kind.absent
        case Maybe():
            return example(kind.inner, salt, is_long=is_long)
        case Many():
            return tuple(example(kind.inner, salt + at, is_long=is_long) for at in range(kind.counts[-1] if kind.counts else 2))
        case Struct():
            fields = {name: example(inner, salt + at, is_long=is_long) for at, (name, inner) in enumerate(kind.fields)}
            return kind.build(**lawful(kind.law, fields))
        case Tagged():
            return example(list(kind.structs.values())[salt % len(kind.structs)], salt, is_long=is_long)
    raise AssertionError(kind)


def example_packet(number: int, *, is_long: bool = False) -> Packet:
    row = ROWS[number]
    mini_status = None if number == 1 else example(MINI_STATUS, number)
    fields = {name: example(kind, number + at, is_long=is_long) for at, (name, kind) in enumerate(row.fields)}
    return row.packet(**lawful(row.law, fields), request_id=number * 1000, mini_status=mini_status)


def to_json(plain: Any) -> Any:
    if isinstance(plain, bytes):
        return {"bin": plain.hex()}
    return [to_json(item) for item in plain] if isinstance(plain, list) else plain


def from_json(value: Any) -> Any:
    if isinstance(value, dict):
        return bytes.fromhex(value["bin"])
    return [from_json(item) for item in value] if isinstance(value, list) else value


def plain_array(packet: Packet) -> list[Any]:
    row = ROWS[packet.TYPE]
    mini_status = None if packet.mini_status is None else MINI_STATUS.plain(packet.mini_status)
    return [packet.TYPE, packet.request_id, mini_status, *(kind.plain(getattr(packet, name)) for name, kind in row.fields)]


def example_record(number: int) -> LogRecord:
    """A log record with an entry of this number."""
    entry = example(LOG_ENTRY.structs[number], number)
    return LogRecord(number, example(DIGEST, number), example(INCARNATION, number), NodeId(number + 1), entry)


def main() -> None:
    _add_packets()
    _add_records()


def _add_records() -> None:
    entries = _entries(LOG_PATH).get("records", {})
    for number in sorted(LOG_ENTRY.structs.keys() - entries.keys()):
        record = example_record(number)
        entries[number] = {
            "number": number,
            "name": LOG_ENTRY.structs[number].name,
            "array": to_json(LOG_RECORD.plain(record)),
            "bytes": record.encode().hex(),
            "hash": record.hash().hex(),
        }
    _write(LOG_PATH, {"records": entries})


def _add_packets() -> None:
    lists = _entries(PATH)
    made = {"packets": lists.get("packets", {}), LONG: lists.get(LONG, {})}
    for what, numbers in (("packets", sorted(ROWS)), (LONG, LONG_NUMBERS)):
        for number in numbers:
            if number not in made[what]:
                packet = example_packet(number, is_long=what == LONG)
                made[what][number] = {
                    "number": number,
                    "name": ROWS[number].name,
                    "array": to_json(plain_array(packet)),
                    "bytes": encode_packet(packet).hex(),
                }
    _write(PATH, made)


def _entries(path: Path) -> dict[str, dict[int, Any]]:
    """The lists of a file, by their names and numbers."""
    lists = json.loads(path.read_text()) if path.exists() else {}
    return {what: {entry["number"]: entry for entry in entries} for what, entries in lists.items()}


def _write(path: Path, lists: dict[str, dict[int, Any]]) -> None:
    parts = []
    for what, entries in lists.items():
        lines = ",\n".join(json.dumps(entries[number], ensure_ascii=False) for number in sorted(entries))
        parts.append(f'"{what}": [\n{lines}\n]')
    path.write_text("{" + ",\n".join(parts) + "}\n")


if __name__ == "__main__":
    main()
