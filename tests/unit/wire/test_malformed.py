"""If this fails, a stranger's bytes can crash a node, fill its memory, or be taken for what they are not."""

from __future__ import annotations

import time
import tracemalloc

import msgpack
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from scenefold.base.errors import PeerFault
from scenefold.base.limits import FRAME_BYTES_MAX, SCENES_LISTED_MAX, SPACES_PER_SCENE_MAX, WRITERS_PER_SCENE_MAX
from scenefold.base.location import FIRST, LAST
from scenefold.wire import (
    GetData,
    MalformedPacket,
    Packet,
    RequestState,
    UnsupportedPacket,
    decode_packet,
    encode_packet,
)
from scenefold.wire.table import RESERVED, ROWS
from unit.wire.strategies import PACKETS

HEARD = [1, 2, bytes(16), 1, "127.0.0.2"]
SAID = [0, 0, 0, 0, 0, 0, 0, 0, 0, [], 0, bytes(64)]
GET = [13, 7, None, 1, 1, bytes(20), 0, b""]


def judge(data: bytes) -> Packet | MalformedPacket:
    """Whatever the bytes are: one or the other, and an accepted packet has exactly these bytes."""
    verdict: Packet | MalformedPacket
    try:
        verdict = decode_packet(data)
    except MalformedPacket as malformed:
        verdict = malformed
    if isinstance(verdict, MalformedPacket):
        assert verdict.field
        assert verdict.problem
        assert str(verdict).isprintable()
    else:
        assert encode_packet(verdict) == data
    return verdict


@given(st.binary(max_size=200))
@example(b"")
@example(b"\x90")
@example(b"\xdd\xff\xff\xff\xff")
@example(b"\x93\x02\x00")
@settings(max_examples=300)
def test_arbitrary_bytes(data: bytes) -> None:
    judge(data)


@given(st.sampled_from(sorted(ROWS)), st.binary(max_size=120))
@settings(max_examples=300)
def test_arbitrary_bytes_behind_a_good_head(number: int, data: bytes) -> None:
    judge(msgpack.packb(list(range(3 + len(ROWS[number].fields))))[:1] + msgpack.packb(number) + b"\x07\xc0" + data)


SCALARS = st.one_of(st.none(), st.booleans(), st.integers(-(2**63), 2**64 - 1), st.floats(), st.text(max_size=5), st.binary(max_size=70))
TREES = st.recursive(SCALARS, lambda inner: st.lists(inner, max_size=5) | st.dictionaries(st.text(max_size=3), inner, max_size=3))


@given(st.lists(TREES, max_size=14), st.integers(0, 70))
@settings(max_examples=300)
def test_arbitrary_messagepack(fields: list[object], number: int) -> None:
    judge(msgpack.packb([number, 1, *fields]))


@given(PACKETS, st.data())
@settings(max_examples=300)
def test_mutated_packets(packet: Packet, data: st.DataObject) -> None:
    good = bytearray(encode_packet(packet)[:4096])
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(good) - 1))
        match data.draw(st.sampled_from(["flip", "set", "cut", "double"])):
            case "flip":
                good[at] ^= 1 << data.draw(st.integers(0, 7))
            case "set":
                good[at] = data.draw(st.sampled_from([0x00, 0x7F, 0x90, 0xC0, 0xC1, 0xC6, 0xCF, 0xD4, 0xDD, 0xDF, 0xE0, 0xFF]))
            case "cut":
                del good[at : at + 1 + data.draw(st.integers(0, 20))]
            case "double":
                good[at:at] = good[at : at + 5]
        if not good:
            break
    judge(bytes(good))


@given(PACKETS)
@settings(max_examples=60)
def test_truncated_anywhere(packet: Packet) -> None:
    good = encode_packet(packet)
    step = max(1, len(good) // 64)
    for size in range(0, len(good), step):
        assert isinstance(judge(good[:size]), MalformedPacket)


@given(PACKETS, st.binary(min_size=1, max_size=9))
@settings(max_examples=60)
def test_trailing_bytes(packet: Packet, rest: bytes) -> None:
    assert isinstance(judge(encode_packet(packet) + rest), MalformedPacket)


@pytest.mark.parametrize(
    ("array", "field", "problem"),
    [
        (GET[:-1], "GetData", "7 fields"),
        ([*GET, 0], "GetData", "9 fields"),
        ([13, 7], "packet", "2 fields"),
        ([13, -1, *GET[2:]], "GetData.request_id", "unsigned"),
        ([13, 7, False, *GET[3:]], "GetData.mini_status", "array"),
        ([13, 7, [1], *GET[3:]], "GetData.mini_status", "1 fields"),
        ([13, 7, None, 0, 1, bytes(20), 0, b""], "GetData.scene", "outside"),
        ([13, 7, None, "1", 1, bytes(20), 0, b""], "GetData.scene", "unsigned integer"),
        ([13, 7, None, True, 1, bytes(20), 0, b""], "GetData.scene", "unsigned integer"),
        ([13, 7, None, 1.0, 1, bytes(20), 0, b""], "GetData.scene", "unsigned integer"),
        ([13, 7, None, 1, 8192, bytes(20), 0, b""], "GetData.space", "outside"),
        ([13, 7, None, 1, 1, bytes(19), 0, b""], "GetData.location", "19 bytes"),
        ([13, 7, None, 1, 1, bytes(21), 0, b""], "GetData.location", "at most 20"),
        ([13, 7, None, 1, 1, "a" * 20, 0, b""], "GetData.location", "raw bytes"),
        ([1, 0, [1, 2, bytes(20), 0, 0, 0, 0, 0, 0], []], "PingBroadcast.mini_status", "nil"),
        ([12, 0, None, 0, 0, None], "RejectData.reason", "0 is no RejectReason"),
        ([12, 0, None, 23, 0, None], "RejectData.reason", "23 is no RejectReason"),
        ([11, 0, None, bytes(65), bytes(20)], "AcceptData.signature", "64 or 384"),
        (
            [32, 0, None, [[1, 1, bytes(20), bytes(64), b"", b""], [1, 0, bytes(20), bytes(64), b"", b""]]],
            "PutMany.items[1].space",
            "",
        ),
        ([36, 0, None, 5, b"text"], "Fault.text", "text was expected"),
        ([36, 0, None, 5, "x" * 1025], "Fault.text", "at most 1024"),
        ([36, 0, None, 5, "\udc80".encode("utf-8", "surrogateescape").decode("latin-1")], None, ""),
        ([23, 0, None, 1, 2, 3, 4, 5, b"", [float("nan")], [], [], [], b""], "SendRays.render_location[0]", "not a number"),
        ([23, 0, None, 1, 2, 3, 4, 5, b"", [float("-inf")], [], [], [], b""], "SendRays.render_location[0]", "finite"),
        ([23, 0, None, 1, 2, 3, 4, 5, b"", [0.0, 0.0], [], [], [], b""], "SendRays.render_location", "2 items"),
        ([23, 0, None, 1, 2, 3, 4, 5, b"", [], [], [], [[6, 7, 0]], b""], "SendRays.batches[0].count", ""),
        ([23, 0, None, 1, 2, 3, 4, 5, bytes(33), [], [], [], [], b""], "SendRays.selective", "at most 32"),
        ([16, 0, None, 1, 1, LAST, FIRST], "QueryRange", "not first ≤ last"),
        ([56, 0, None, 1, 0, 2, 2, b""], "FilmPart", "not part_index < part_count"),
        ([58, 0, None, 1, 2, 3, b""], "ImagePart", "not offset ≤ total_bytes"),
        ([1, 0, None, [[*HEARD, FIRST, None, *SAID]]], "PingBroadcast.statuses[0]", "not left_fence needs right_bound"),
        ([1, 0, None, [[*HEARD, LAST, LAST, *SAID]]], "PingBroadcast.statuses[0]", "left_fence < right_bound"),
        ([17, 0, None, 1, 1, FIRST, LAST, [FIRST, LAST], [bytes(16)], False], "ReturnRange", "as many as locations"),
        ([17, 0, None, 1, 1, FIRST, LAST, [FIRST], [bytes(15)], False], "ReturnRange.objects[0]", "15 bytes"),
        ([41, 0, None, bytes(16), [1, bytes(16)], [2, bytes(16)], LAST, FIRST, 0, 0, 0], "OfferRange", "not first ≤ last"),
        ([66, 0, None, bytes(16), [4096]], "RecordsWanted.indexes[0]", "outside"),
        ([74, 0, None, True, True], "DrainNode", "not at most one of check_only, cancel"),
        ([128, 0, None], "type", "128 is no packet"),
        ([0, 0, None], "type", "0 is no packet"),
        ([2**64 - 1, 0, None], "type", "is no packet"),
        ({"type": 13}, "packet", "array"),
        (None, "packet", "array"),
    ],
)
def test_the_error_names_the_field(array: object, field: str | None, problem: str) -> None:
    verdict = judge(msgpack.packb(array))
    if field is None:
        assert isinstance(verdict, Packet)
        return
    assert isinstance(verdict, MalformedPacket)
    assert verdict.field == field
    assert problem in verdict.problem
    assert isinstance(verdict, PeerFault)


def test_text_that_is_not_utf8() -> None:
    assert judge(b"\x95\x24\x00\xc0\x05\xa1\xff").field == "Fault.text"  # type: ignore[union-attr]


@pytest.mark.parametrize("longer", [b"\xcc\x0d", b"\xcd\x00\x0d", b"\xce\x00\x00\x00\x0d", b"\xcf" + bytes(7) + b"\x0d"])
def test_only_the_shortest_form(longer: bytes) -> None:
    good = msgpack.packb(GET)
    assert isinstance(judge(good[:1] + longer + good[2:]), MalformedPacket)
    assert isinstance(judge(b"\xdc\x00" + bytes([len(GET)]) + good[1:]), MalformedPacket)


def test_the_request_id_survives_for_the_answer() -> None:
    assert judge(msgpack.packb([13, 77, None, 0, 1, bytes(20), 0, b""])).request_id == 77
    assert judge(msgpack.packb([44, 78, None, 1])).request_id == 78
    assert judge(msgpack.packb([200, 79, None, 1])).request_id == 79
    assert judge(msgpack.packb([13, 1 << 32, None])).request_id is None


@pytest.mark.parametrize("number", sorted(RESERVED))
def test_reserved_numbers_are_not_supported(number: int) -> None:
    with pytest.raises(UnsupportedPacket, match="not supported") as caught:
        decode_packet(msgpack.packb([number, 5, None, "anything"]))
    assert (caught.value.number, caught.value.request_id) == (number, 5)


def test_a_later_version_may_append_fields() -> None:
    longer = msgpack.packb([*GET, {"later": [1, 2.5, None]}, b"x"])
    assert decode_packet(longer, version=2) == GetData(1, 1, FIRST, 0, request_id=7)
    assert isinstance(judge(longer), MalformedPacket)
    with pytest.raises(MalformedPacket):
        decode_packet(msgpack.packb(GET[:-1]), version=2)
    with pytest.raises(MalformedPacket, match="nested"):
        decode_packet(msgpack.packb([*GET, None])[:-1] + b"\x91" * 1000 + b"\xc0", version=2)
    assert decode_packet(msgpack.packb([2, 0, None, 1]), version=9) == RequestState()


def _list_of_scenes() -> bytes:
    writers = [[0, 0, 0]] * WRITERS_PER_SCENE_MAX
    spaces = [[1, 0, bytes(20), 0, 0, False]] * SPACES_PER_SCENE_MAX
    scene = [1, bytes(32), 0, 0, 0, 0, spaces, writers, 0, 0, [], bytes(64)]
    count = min(SCENES_LISTED_MAX, (FRAME_BYTES_MAX - 64) // len(msgpack.packb(scene)))
    return bytes(msgpack.packb([38, 0, None, [scene] * count]))


HOSTILE = {
    "empty arrays": b"\x94\x20\x00\xc0\xdd\x00\x7f\xff\xf0" + b"\x90" * 0x7FFFF0,
    "claims": b"\x94\x20\x00\xc0" + b"\xdd\x00\x7f\xff\xff" * 1_000_000,
    "nested": b"\x91" * FRAME_BYTES_MAX,
    "items": msgpack.packb([35, 0, None, [None] * 1_000_000]),
    "locations": msgpack.packb([17, 0, None, 1, 1, bytes(20), LAST, [bytes(20)] * 65536, [bytes(16)] * 65536, True]),
    "text": msgpack.packb([36, 0, None, 5, "x" * 8_000_000]),
    "frame": bytes(FRAME_BYTES_MAX + 1),
    "scenes": _list_of_scenes(),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_time_and_memory_are_bounded(name: str) -> None:
    data = HOSTILE[name]
    begin = time.process_time()
    judge_only(data)
    # Some ten times what it takes here: this guards against quadratic work, not against a busy machine.
    assert time.process_time() - begin < 8.0
    if name != "scenes":  # Tracing is slow, and this one is honest: all of it is wanted.
        tracemalloc.start()
        try:
            judge_only(data)
            assert tracemalloc.get_traced_memory()[1] < 24 * 1024 * 1024
        finally:
            tracemalloc.stop()


def judge_only(data: bytes) -> None:
    try:
        decode_packet(data)
    except MalformedPacket:
        return
