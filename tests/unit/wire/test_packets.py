"""If this fails, two nodes would read one packet differently, or not at all."""

from __future__ import annotations

import dataclasses

import msgpack
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.base.errors import LocalFault
from scenefold.base.limits import BULK_BYTES_MAX, CIPHERTEXT_BYTES_MAX, FRAME_BYTES_MAX
from scenefold.base.location import FIRST, LAST
from scenefold.wire import (
    FilmPart,
    GetData,
    MiniStatus,
    Packet,
    PingBroadcast,
    ProposeData,
    PutItem,
    PutMany,
    QueryRange,
    RayBatch,
    RequestState,
    ReturnRange,
    SendRays,
    StartJob,
    decode_packet,
    encode_frame,
    encode_packet,
    frame,
)
from scenefold.wire.table import ROWS
from unit.wire.strategies import packets_of

STATUS = MiniStatus(1, 2130706434, LAST, 0, 0, 0, 0, 0)


@pytest.mark.parametrize("number", sorted(ROWS), ids=lambda number: f"{number}-{ROWS[number].name}")
def test_round_trip(number: int) -> None:
    @settings(max_examples=25)
    @given(packets_of(number))
    def check(packet: Packet) -> None:
        data = encode_packet(packet)
        assert decode_packet(data) == packet
        assert decode_packet(memoryview(data)) == packet
        assert encode_frame(packet) == frame(data)

    check()


@pytest.mark.parametrize("number", sorted(ROWS), ids=lambda number: f"{number}-{ROWS[number].name}")
def test_any_messagepack_library_reads_it(number: int) -> None:
    @settings(max_examples=10)
    @given(packets_of(number))
    def check(packet: Packet) -> None:
        array = msgpack.unpackb(encode_packet(packet))
        assert array[:2] == [number, packet.request_id]
        assert len(array) == 3 + len(ROWS[number].fields)
        assert msgpack.packb(array) == encode_packet(packet)

    check()


def test_packets_are_frozen_and_slotted() -> None:
    for row in ROWS.values():
        assert row.packet.__dataclass_params__.frozen  # type: ignore[attr-defined]
        assert not hasattr(row.packet, "__dict__") or "__dict__" not in dir(row.packet)
    packet = RequestState(request_id=5)
    with pytest.raises(dataclasses.FrozenInstanceError):
        packet.request_id = 6  # type: ignore[misc]


@given(st.sampled_from([bytearray, memoryview]))
def test_any_buffer_can_be_sent(buffer: type) -> None:
    packet = SendRays(1, 2, 3, 4, 5, b"", (0.5,), (), (), (RayBatch(6, 7, 1),), buffer(b"r" * 36))
    assert decode_packet(encode_packet(packet)) == dataclasses.replace(packet, rays=b"r" * 36)


@pytest.mark.parametrize(
    ("packet", "field"),
    [
        (GetData(0, 1, FIRST, 0), "GetData.scene"),
        (GetData(1, 0, FIRST, 0), "GetData.space"),
        (GetData(1, 8192, FIRST, 0), "GetData.space"),
        (GetData(1, 1, b"short", 0), "GetData.location"),
        (GetData(1, 1, FIRST, -1), "GetData.position"),
        (GetData(1, 1, FIRST, 1 << 64), "GetData.position"),
        (GetData(True, 1, FIRST, 0), "GetData.scene"),
        (GetData(1.0, 1, FIRST, 0), "GetData.scene"),
        (GetData(1, 1, FIRST, 0, request_id=1 << 32), "GetData.request_id"),
        (GetData(1, 1, FIRST, 0, mini_status=(1, 2)), "GetData.mini_status"),
        (PingBroadcast((), mini_status=STATUS), "PingBroadcast.mini_status"),
        (PutMany((PutItem(1, 1, FIRST, b"s" * 63, b"", b""),)), "PutMany.items[0].signature"),
        (PutMany("text"), "PutMany.items"),
        (PutMany(item for item in ()), "PutMany.items"),
        (ProposeData(1, 1, FIRST, b"s" * 64, b"", b"x" * (CIPHERTEXT_BYTES_MAX + 1)), "ProposeData.ciphertext"),
        (ReturnRange(1, 1, FIRST, LAST, (FIRST,) * 65537), "ReturnRange.locations"),
        (SendRays(1, 2, 3, 4, 5, b"", (1.0, 2.0), (), (), (), b""), "SendRays.render_location"),
        (SendRays(1, 2, 3, 4, 5, b"", (float("inf"),), (), (), (), b""), "SendRays.render_location[0]"),
        (SendRays(1, 2, 3, 4, 5, b"", (1,), (), (), (), b""), "SendRays.render_location[0]"),
        (SendRays(1, 2, 3, 0, 5, b"", (), (), (), (), b""), "SendRays.link_sequence"),
        (SendRays(1, 2, 3, 4, 5, b"", (), (), (), (RayBatch(6, 7, 0),), b""), "SendRays.batches[0].count"),
        (QueryRange(1, 1, LAST, FIRST), "QueryRange"),
        (FilmPart(1, 0, 1, 1, b""), "FilmPart"),
        (StartJob(1, "text"), "StartJob.document"),
        (StartJob(1, None), "StartJob.document"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_we_would_not_accept_we_do_not_send(packet: Packet, field: str) -> None:
    with pytest.raises(LocalFault) as caught:
        encode_packet(packet)
    assert caught.value.where == field


def test_a_full_part_fits_a_frame_and_a_fuller_packet_does_not() -> None:
    part = FilmPart(1, 0, 0, 1, bytes(BULK_BYTES_MAX), mini_status=STATUS)
    assert decode_packet(encode_packet(part)) == part
    item = PutItem(1, 1, FIRST, bytes(64), bytes(181), bytes(60_000))
    with pytest.raises(LocalFault, match="exceeds a frame"):
        encode_packet(PutMany((item,) * (FRAME_BYTES_MAX // 60_000 + 1)))


def test_what_is_no_packet_is_not_sent() -> None:
    class Stranger(GetData):
        pass

    for impostor in (Packet(), Stranger(1, 1, FIRST, 0)):
        with pytest.raises(LocalFault, match="no packet of the table"):
            encode_packet(impostor)
