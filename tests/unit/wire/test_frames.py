"""If this fails, packets on a stream run into each other, or a stranger's length fills the memory."""

from __future__ import annotations

import struct
import time
import tracemalloc

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import LocalFault
from scenefold.base.limits import FRAME_BYTES_MAX
from scenefold.wire import FrameReader, MalformedPacket, frame

_payloads = st.binary(min_size=1, max_size=60) | st.integers(4000, 9000).map(lambda size: bytes(range(250)) * (size // 250))


@given(st.lists(_payloads, max_size=8), st.data())
def test_any_cutting_of_the_stream_gives_the_same_frames(payloads: list[bytes], data: st.DataObject) -> None:
    stream = b"".join(map(frame, payloads))
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=12)))
    reader = FrameReader()
    found: list[bytes] = []
    for first, last in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        found += reader.feed(stream[first:last])
    assert found == payloads
    assert reader.at_boundary


@given(st.binary(min_size=1, max_size=30), st.data())
def test_a_truncated_frame_is_noticed(payload: bytes, data: st.DataObject) -> None:
    whole = frame(payload)
    reader = FrameReader()
    assert reader.feed(whole[: data.draw(st.integers(1, len(whole) - 1))]) == []
    assert not reader.at_boundary


@pytest.mark.parametrize("length", [0, FRAME_BYTES_MAX + 1, 2**32 - 1])
def test_the_length_is_judged_before_the_frame_arrives(length: int) -> None:
    reader = FrameReader()
    with pytest.raises(MalformedPacket, match="allowed") as caught:
        reader.feed(struct.pack(">I", length))
    assert caught.value.field == "frame.length"


def test_the_limit_itself_is_allowed() -> None:
    payload = bytes(FRAME_BYTES_MAX)
    assert FrameReader().feed(frame(payload)) == [payload]
    for size in (0, FRAME_BYTES_MAX + 1):
        with pytest.raises(LocalFault):
            frame(bytes(size))


def test_a_smaller_limit_for_strangers() -> None:
    with pytest.raises(MalformedPacket):
        FrameReader(100).feed(frame(bytes(101)))


def test_small_pieces_cost_no_quadratic_time() -> None:
    stream = frame(bytes(FRAME_BYTES_MAX)) + frame(b"x") * 50_000
    begin = time.process_time()
    reader = FrameReader()
    count = sum(len(reader.feed(stream[at : at + 256])) for at in range(0, len(stream), 256))
    assert (count, reader.at_boundary) == (50_001, True)
    count = len(reader.feed(frame(b"x") * 100_000))
    assert count == 100_000
    assert time.process_time() - begin < 5.0


def test_what_has_come_of_a_frame_takes_no_more_memory_than_it_has_bytes() -> None:
    reader = FrameReader()
    reader.feed(struct.pack(">I", 1 << 18))
    tracemalloc.start()
    try:
        for number in range(1 << 15):
            # Single bytes, and now and then a few at once.
            assert reader.feed(b"x" * (1 + number % 5)) == []
        held, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert held < most < (1 << 17) + (1 << 15)


def test_large_pieces_are_kept_as_they_came() -> None:
    pieces = [bytes([number]) * 8192 for number in range(8)]
    stream = [struct.pack(">I", 8 * 8192), *pieces]
    reader = FrameReader()
    tracemalloc.start()
    try:
        found = [frame for piece in stream[:-1] for frame in reader.feed(piece)]
        assert tracemalloc.get_traced_memory()[0] < 8192, "nothing is copied before the frame is whole"
        found += reader.feed(stream[-1])
    finally:
        tracemalloc.stop()
    assert found == [b"".join(pieces)]


def test_a_buffer_may_be_reused_by_the_caller() -> None:
    buffer = bytearray(frame(b"abc"))
    reader = FrameReader()
    reader.feed(memoryview(buffer)[:2])
    reader.feed(memoryview(buffer)[2:5])
    buffer[:5] = bytes(5)
    assert reader.feed(bytes(buffer[5:])) == [b"abc"]
