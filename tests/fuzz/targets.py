"""What the fuzzer feeds, and the laws that must hold of whatever comes in: a value or MalformedPacket, nothing else;
what was accepted has exactly these bytes.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence

from fuzz import datagrams, enrolling, scenes
from fuzz.findings import Finding
from scenefold.wire import (
    FrameReader,
    LogRecord,
    LogValue,
    MalformedPacket,
    SceneBody,
    SceneCertificate,
    SceneLogPublic,
    ShortenedLog,
    SnapshotState,
    decode_packet,
    encode_frame,
    encode_packet,
    frame,
    pack_log,
    pack_value,
    unpack_log,
    unpack_value,
)
from scenefold.wire.orders import EnrolForm, Order
from scenefold.wire.pieces import pack_piece, unpack_piece
from scenefold.wire.status_packets import STATUS

Target = Callable[[bytes, random.Random], str]
"""Takes an input; gives a short text of what became of it, for telling new ways from known ones. Finding otherwise."""


def _refused(error: MalformedPacket) -> str:
    if not error.field or not error.problem or not str(error).isprintable():
        raise Finding(f"a refusal that says nothing readable: {error!r}")
    shape = "".join("#" if letter.isdigit() else letter for letter in f"{error.field}: {error.problem}")
    return f"refused {shape[:160]}"


def _same(found: bytes, data: bytes, what: str) -> str:
    if found != data:
        raise Finding(f"{what} was accepted from bytes that are not its own")
    return f"accepted {what}"


def packet(data: bytes, _dice: random.Random) -> str:
    try:
        found = decode_packet(data)
    except MalformedPacket as error:
        return _refused(error)
    if encode_frame(found) != frame(data):
        raise Finding("the frame of a packet is not its bytes' frame")
    return _same(encode_packet(found), data, type(found).__name__)


def packet_of_a_later_version(data: bytes, _dice: random.Random) -> str:
    """May have more fields than are known; those that are known must still be right."""
    try:
        found = decode_packet(data, version=2)
    except MalformedPacket as error:
        return _refused(error)
    if len(encode_packet(found)) > len(data):
        raise Finding("a packet is longer than the bytes that it came from")
    return f"accepted {type(found).__name__}"


def frames(data: bytes, dice: random.Random) -> str:
    """A stream in pieces: the frames are the same however it was cut, and no byte is lost."""
    try:
        whole = FrameReader().feed(data)
    except MalformedPacket as error:
        outcome, whole = _refused(error), None
    reader, found, at = FrameReader(), list[bytes](), 0
    try:
        while at < len(data):
            size = dice.choice([1, 2, 3, 5, 64, 1500, 1 << 14])
            found += reader.feed(data[at : at + size])
            at += size
    except MalformedPacket:
        if whole is not None:
            raise Finding("a stream was refused in pieces and taken at once") from None
        return outcome
    if whole is None or whole != found:
        raise Finding("a stream gives other frames when it is cut otherwise")
    used = b"".join(map(frame, found))
    if data[: len(used)] != used or reader.at_boundary != (used == data):
        raise Finding("bytes of a stream were lost")
    return f"frames {min(len(found), 3)}"


def _piece(decode: Callable[[bytes], object], encode: Callable[[object], bytes], name: str) -> Target:
    def target(data: bytes, _dice: random.Random) -> str:
        try:
            found = decode(data)
        except MalformedPacket as error:
            return _refused(error)
        return _same(encode(found), data, name)

    return target


_PIECES = LogRecord | SceneLogPublic | Order | EnrolForm | SceneCertificate | SceneBody | LogValue | ShortenedLog | SnapshotState


def _encoded(value: object) -> bytes:
    assert isinstance(value, _PIECES)
    return value.encode()


def _packed_log(value: object) -> bytes:
    assert isinstance(value, Sequence)
    return pack_log(value)


TARGETS: dict[str, Target] = {
    "packet": packet,
    "later": packet_of_a_later_version,
    "frames": frames,
    "status": _piece(lambda data: unpack_piece(STATUS, data), lambda value: pack_piece(STATUS, value), "Status"),  # type: ignore[arg-type]
    "header": _piece(SceneLogPublic.decode, _encoded, "SceneLogPublic"),
    "decided": scenes.decided,
    "certificate": _piece(SceneCertificate.decode, _encoded, "SceneCertificate"),
    "value": _piece(LogValue.decode, _encoded, "LogValue"),
    "body": _piece(SceneBody.decode, _encoded, "SceneBody"),
    "lockbox": scenes.lockbox,
    "former": scenes.former,
    "former plain": scenes.former_plain,
    "record": _piece(LogRecord.decode, _encoded, "LogRecord"),
    "log": _piece(unpack_log, _packed_log, "log"),
    "shortened": _piece(ShortenedLog.decode, _encoded, "ShortenedLog"),
    "snapshot": _piece(SnapshotState.decode, _encoded, "SnapshotState"),
    "state": scenes.state,
    "datagram": datagrams.datagram,
    "contents": datagrams.contents,
    "order": _piece(Order.decode, _encoded, "Order"),
    "form": _piece(EnrolForm.decode, _encoded, "EnrolForm"),
    "card": enrolling.card,
    "token": enrolling.token,
    "question": enrolling.question,
    "document": _piece(unpack_value, pack_value, "document"),  # type: ignore[arg-type]
}
