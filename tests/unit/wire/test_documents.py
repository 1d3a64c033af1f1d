"""If this fails, equal scenes would have different hashes, or a document could exhaust a node."""

from __future__ import annotations

import math
import tracemalloc

import msgpack
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.base.errors import LocalFault
from scenefold.base.limits import VALUE_DEPTH_MAX, VALUE_ITEMS_MAX
from scenefold.wire import MalformedPacket, pack_value, unpack_value

TEXTS = st.text(max_size=40)
SCALARS = st.one_of(st.none(), st.booleans(), st.integers(-(2**63), 2**64 - 1), st.floats(allow_nan=False), TEXTS, st.binary(max_size=300))
VALUES = st.recursive(SCALARS, lambda inner: st.lists(inner, max_size=20) | st.dictionaries(TEXTS, inner, max_size=20), max_leaves=40)


@given(VALUES)
@settings(max_examples=200)
def test_round_trip_and_any_library_reads_it(value: object) -> None:
    data = pack_value(value)
    assert unpack_value(data) == value
    assert repr(unpack_value(data)) == repr(msgpack.unpackb(data))


@given(
    st.dictionaries(TEXTS, st.integers(), max_size=8).filter(lambda value: all(-(2**63) <= v < 2**64 for v in value.values())), st.randoms()
)
def test_equal_values_have_equal_bytes(value: dict[str, int], shuffler: object) -> None:
    keys = list(value)
    shuffler.shuffle(keys)  # type: ignore[attr-defined]
    assert pack_value({key: value[key] for key in keys}) == pack_value(value)


@given(st.binary(max_size=60))
@settings(max_examples=400)
def test_arbitrary_bytes_are_refused_or_have_exactly_this_encoding(data: bytes) -> None:
    complaint = None
    try:
        value = unpack_value(data)
    except MalformedPacket as malformed:
        complaint = malformed
    if complaint is None:
        assert pack_value(value) == data
    else:
        assert complaint.field.startswith("document")
        assert str(complaint).isprintable()


@given(VALUES, st.data())
@settings(max_examples=200)
def test_mutated_documents(value: object, data: st.DataObject) -> None:
    mutated = bytearray(pack_value(value))
    mutated[data.draw(st.integers(0, len(mutated) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    test_arbitrary_bytes_are_refused_or_have_exactly_this_encoding.hypothesis.inner_test(bytes(mutated))  # type: ignore[attr-defined]


@pytest.mark.parametrize("value", [math.inf, -math.inf, -0.0, 1e-320])
def test_unusual_floats(value: float) -> None:
    assert repr(unpack_value(pack_value(value))) == repr(value)


def test_tuples_and_buffers_pack_as_lists_and_bytes() -> None:
    assert unpack_value(pack_value({"a": (1, bytearray(b"x"), memoryview(b"y"))})) == {"a": [1, b"x", b"y"]}


@pytest.mark.parametrize(
    ("value", "where"),
    [
        (math.nan, "job"),
        ({"a": [1, math.nan]}, "job.a[1]"),
        (2**64, "job"),
        (-(2**63) - 1, "job"),
        ({1: 2}, "job"),
        ({"a": {b"x": 1}}, "job.a"),
        ({"a": {1, 2}}, "job.a"),
        ({"a\n": {"b" * 100: math.nan}}, f"job.'a\\n'.{'b' * 40}…"),
        ("\ud800", "job"),
        ({"\ud800": 1}, "job"),
        ([0] * (VALUE_ITEMS_MAX + 1), "job"),
    ],
    ids=str,
)
def test_what_has_no_encoding(value: object, where: str) -> None:
    with pytest.raises(LocalFault) as caught:
        pack_value(value, what="job")
    assert caught.value.where == where


def test_limits_hold_on_both_sides() -> None:
    deep: object = 1
    for _ in range(VALUE_DEPTH_MAX):
        deep = [deep]
    assert unpack_value(pack_value(deep)) == deep
    with pytest.raises(LocalFault, match="nested"):
        pack_value([deep])
    with pytest.raises(MalformedPacket, match="nested"):
        unpack_value(msgpack.packb([deep]))
    with pytest.raises(LocalFault, match="at most 10"):
        pack_value("x" * 20, size_max=10)
    with pytest.raises(MalformedPacket, match="at most 10"):
        unpack_value(pack_value("x" * 20), size_max=10)
    with pytest.raises(MalformedPacket, match="items"):
        unpack_value(msgpack.packb([0] * (VALUE_ITEMS_MAX + 1)))


@pytest.mark.parametrize("empty", [[], {}])
def test_what_is_empty_is_as_deep_as_what_is_not(empty: object) -> None:
    for depth in range(1, VALUE_DEPTH_MAX + 1):
        nest: object = empty
        for _ in range(depth - 1):
            nest = [nest, 0.0]
        assert unpack_value(pack_value(nest)) == nest
    with pytest.raises(LocalFault, match="deeper"):
        pack_value([nest])
    with pytest.raises(MalformedPacket, match="deeper"):
        unpack_value(msgpack.packb([nest]))


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\xc1",
        b"\xd4\x00\x00",  # an extension
        b"\xca\x00\x00\x00\x00",  # a float of 32 bits
        b"\xcc\x01",  # not the shortest form
        b"\xd0\x01",
        b"\xd9\x01a",
        b"\xc5\x00\x01a",
        b"\xdc\x00\x01\x00",
        b"\xde\x00\x01\xa1a\x00",
        b"\x82\xa1b\x00\xa1a\x00",  # keys that descend
        b"\x82\xa1a\x00\xa1a\x00",  # a key twice
        b"\x81\x00\x00",  # a key that is no text
        b"\x00\x00",  # trailing bytes
        b"\xa1\xff",
        b"\xcb\x7f\xf8\x00\x00\x00\x00\x00\x00",
        b"\xdf\xff\xff\xff\xff",
        b"\xc6\xff\xff\xff\xffa",
    ],
    ids=bytes.hex,
)
def test_refused(data: bytes) -> None:
    with pytest.raises(MalformedPacket):
        unpack_value(data)


@pytest.mark.parametrize("data", [b"\xdd\x00\x7f\xff\xf0" + b"\x90" * 0x7FFFF0, b"\x91" * 1_000_000, b"\xdd\x00\x02\xff\xff" * 200_000])
def test_memory_is_bounded(data: bytes) -> None:
    tracemalloc.start()
    try:
        with pytest.raises(MalformedPacket):
            unpack_value(data)
        assert tracemalloc.get_traced_memory()[1] < 24 * 1024 * 1024
    finally:
        tracemalloc.stop()
