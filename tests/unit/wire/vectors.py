"""Golden packets: one example of each, made from the table, written to specs/vectors/packets.json.

The file pins the bytes: it is written once for a packet and changes only when the protocol's version does. To add
what is new: `PYTHONPATH=tests .venv/bin/python -m unit.wire.vectors`; it keeps every entry that exists.

In the file bytes stand as {"bin": hexadecimal}; everything else as in JSON. "array" is the MessagePack array.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from scenefold.base.location import Location
from scenefold.wire import encode_packet
from scenefold.wire.common import MINI_STATUS, Packet
from scenefold.wire.containers import Many, Struct
from scenefold.wire.kinds import Bin, Choice, Flag, Float, Kind, Maybe, Place, Text, Uint
from scenefold.wire.table import ROWS

PATH = Path(__file__).resolve().parents[3] / "specs" / "vectors" / "packets.json"


def example(kind: Kind[Any], salt: int) -> Any:
    """A value of this kind that uses its width: no two fields of a packet alike."""
    match kind:
        case Uint():
            return min(kind.most, kind.least + salt * 0x0123456789AB % (kind.most - kind.least + 1))
        case Choice():
            return list(kind.members)[salt % len(kind.members)]
        case Flag():
            return salt % 2 == 0
        case Float():
            return salt + 0.25
        case Bin():
            size = kind.lengths[-1 if kind.lengths[-1] <= 32 else 0] if kind.lengths else 5
            size = 64 if 64 in kind.lengths else size
            return bytes((salt + at) % 256 for at in range(size))
        case Text():
            return f"text {salt} é"
        case Place():
            return Location(bytes((salt * 7 + at) % 256 for at in range(20)))
        case Maybe():
            return example(kind.inner, salt)
        case Many():
            return tuple(example(kind.inner, salt + at) for at in range(kind.counts[-1] if kind.counts else 2))
        case Struct():
            return kind.build(*(example(inner, salt + at) for at, (_, inner) in enumerate(kind.fields)))
    raise AssertionError(kind)


def example_packet(number: int) -> Packet:
    row = ROWS[number]
    mini_status = None if number == 1 else example(MINI_STATUS, number)
    fields = {name: example(kind, number + at) for at, (name, kind) in enumerate(row.fields)}
    law = row.law
    if law and fields[law.lower] > fields[law.upper]:
        fields[law.lower], fields[law.upper] = fields[law.upper], fields[law.lower]
    return row.packet(**fields, request_id=number * 1000, mini_status=mini_status)


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


def main() -> None:
    entries = {entry["number"]: entry for entry in json.loads(PATH.read_text())["packets"]} if PATH.exists() else {}
    for number in sorted(ROWS.keys() - entries.keys()):
        packet = example_packet(number)
        entries[number] = {
            "number": number,
            "name": ROWS[number].name,
            "array": to_json(plain_array(packet)),
            "bytes": encode_packet(packet).hex(),
        }
    lines = ",\n".join(json.dumps(entries[number], ensure_ascii=False) for number in sorted(entries))
    PATH.write_text(f'{{"packets": [\n{lines}\n]}}\n')


if __name__ == "__main__":
    main()
