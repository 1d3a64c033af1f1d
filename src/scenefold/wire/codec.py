"""Packets to bytes and back, from the table alone (specs/03-wire.md, Encoding).

    packet  =  [ type, request_id, mini_status | nil, field, field, ... ]        one MessagePack array

Encoding checks every field against its kind first and blames our caller (LocalFault); decoding does the same
and blames the sender (MalformedPacket, and nothing else). Both are plain functions, safe in any thread.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any

import msgpack

from scenefold.base.errors import LocalFault
from scenefold.base.limits import FRAME_BYTES_MAX
from scenefold.wire.common import MINI_STATUS, U32, Packet, Row
from scenefold.wire.containers import Struct, since_of
from scenefold.wire.documents import skip_value
from scenefold.wire.errors import MalformedPacket, Misfit, NotSpoken, UnsupportedPacket
from scenefold.wire.kinds import Kind, Maybe, Nothing
from scenefold.wire.table import RESERVED, ROWS
from scenefold.wire.tokens import TRUNCATED, read_array_head, read_uint

PROTOCOL_VERSION = 1
"""The highest that this module speaks; the handshake of each connection agrees on one (world/versions.py)."""
FIRST_VERSION = 1
"""What is spoken where no handshake has agreed on anything: in datagrams, and by newcomers."""

_HEAD_FIELDS = 3
_PING_BROADCAST = 1


def layouts_of(rows: Mapping[int, Row], version: int) -> dict[int, Struct[Any]]:
    """The packets of a version, each with the fields that it has there."""
    return {number: _layout(row, version) for number, row in rows.items() if row.since <= version}


def _layout(row: Row, version: int) -> Struct[Any]:
    # A PingBroadcast consists of whole statuses: the small one would only repeat the first of them.
    mini_status: Kind[Any] = Nothing() if row.number == _PING_BROADCAST else Maybe(MINI_STATUS)
    fields = [field for field in row.fields if since_of(field[1]) <= version]
    return Struct(row.packet, ("request_id", U32), ("mini_status", mini_status), *fields)


_LAYOUTS = {version: layouts_of(ROWS, version) for version in range(FIRST_VERSION, PROTOCOL_VERSION + 1)}


def _spoken(version: int) -> dict[int, Struct[Any]]:
    """What this module knows of a version: of a later one than its own, what that one has in common with it."""
    return _LAYOUTS[min(version, PROTOCOL_VERSION)]


def encode_packet(packet: Packet, *, version: int = FIRST_VERSION) -> bytes:
    """The packet's bytes in a version, without the length of a frame; LocalFault names the field that is out of bounds.

    NotSpoken, as if the peer had refused it, if that version has no such packet.
    """
    packed: bytes = _pack(packet, version).bytes()
    return packed


def encode_frame(packet: Packet, *, version: int = FIRST_VERSION) -> bytes:
    """The packet as a whole frame, ready to be sent. Saves the copy that `frame(encode_packet(packet))` makes."""
    with _pack(packet, version).getbuffer() as body:
        return b"".join((struct.pack(">I", len(body)), body))


def _pack(packet: Packet, version: int) -> Any:
    number = packet.TYPE
    layout = _spoken(version).get(number)
    if layout is None and number in ROWS:
        raise NotSpoken(type(packet).__name__, version)
    if layout is None or type(packet) is not layout.build:
        raise LocalFault(f"{type(packet).__name__} is no packet of the table")
    try:
        plain = layout.plain_fields(packet)
    except Misfit as misfit:
        raise LocalFault(f"the packet cannot be sent: {misfit.problem}", where=f"{layout.name}{misfit.path}") from None
    law = ROWS[number].law
    if law and not law.holds(packet):
        raise LocalFault(f"the packet cannot be sent: not {law}", where=layout.name)
    packer = msgpack.Packer(autoreset=False)
    packer.pack([number, *plain])
    with packer.getbuffer() as body:
        if len(body) > FRAME_BYTES_MAX:
            raise LocalFault(
                f"the packet of {len(body)} bytes exceeds a frame's {FRAME_BYTES_MAX}",
                where=layout.name,
                remedy="send fewer items in one packet",
            )
    return packer


def decode_packet(data: bytes | bytearray | memoryview, *, version: int = FIRST_VERSION) -> Packet:
    """The packet that `data` is, wholly. MalformedPacket, with the field's name, is all that it raises.

    `version` is the connection's: of a later one than ours, packets may have more fields at their ends, and we not know all packets.
    """
    if len(data) > FRAME_BYTES_MAX:
        raise MalformedPacket("frame", f"{len(data)} bytes, at most {FRAME_BYTES_MAX} are allowed")
    data = bytes(data)
    request_id: int | None = None
    name = "packet"
    try:
        count, at = read_array_head(data, 0)
        if count < _HEAD_FIELDS:
            raise Misfit(f"{count} fields, at least {_HEAD_FIELDS} were expected")
        name = "type"
        number, at = read_uint(data, at)
        layout = _spoken(version).get(number)
        name = "request_id" if layout is None else layout.name
        request_id = _peek_request_id(data, at)
        if layout is None:
            raise _unknown(number, request_id, version)
        _check_count(count, len(layout.fields) + 1, version)
        (packet_id, mini_status, *values), at = layout.read_fields(data, at)
        for _ in range(count - len(layout.fields) - 1):
            at = skip_value(data, at)
        if at != len(data):
            raise Misfit(f"{len(data) - at} bytes too many")
    except Misfit as misfit:
        raise MalformedPacket(f"{name}{misfit.path}", misfit.problem, request_id=request_id) from None
    except TRUNCATED:
        raise MalformedPacket(name, "truncated", request_id=request_id) from None
    packet: Packet = layout.build(*values, request_id=packet_id, mini_status=mini_status)
    law = ROWS[number].law
    if law and not law.holds(packet):
        raise MalformedPacket(name, f"not {law}", request_id=request_id)
    return packet


def request_id_of(data: bytes) -> int | None:
    """That of a packet, without a look at what is behind it; None if it cannot be read."""
    try:
        _, at = read_array_head(data, 0)
        _, at = read_uint(data, at)
    except (Misfit, *TRUNCATED):
        return None
    return _peek_request_id(data, at)


def _peek_request_id(data: bytes, at: int) -> int | None:
    """The request id for the error that may follow; None if it cannot be read."""
    try:
        value, _ = read_uint(data, at)
    except (Misfit, *TRUNCATED):
        return None
    return value if value <= U32.most else None


def _unknown(number: int, request_id: int | None, version: int) -> MalformedPacket:
    if number in RESERVED:
        return UnsupportedPacket(number, RESERVED[number], request_id=request_id)
    if version > PROTOCOL_VERSION:
        return UnsupportedPacket(number, f"is no packet of version {PROTOCOL_VERSION}", request_id=request_id)
    return MalformedPacket("type", f"{number} is no packet", request_id=request_id)


def _check_count(count: int, expected: int, version: int) -> None:
    if count < expected or (count > expected and version <= PROTOCOL_VERSION):
        raise Misfit(f"{count} fields, {expected} were expected in version {min(version, PROTOCOL_VERSION)}")
