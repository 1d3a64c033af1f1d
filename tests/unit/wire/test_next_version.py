"""If one fails, a cluster cannot be brought to the next version a node at a time: programs of two versions do not understand each other."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from following_version import ADDED, NEXT, OURS, Longer, Wave, next_version
from scenefold.base.errors import Refused
from scenefold.base.reasons import RejectReason
from scenefold.wire import Fault, MalformedPacket, NotSpoken, Packet, UnsupportedPacket, codec, decode_packet, encode_frame, encode_packet
from scenefold.wire.common import U32, Carrier, row
from scenefold.wire.containers import Since
from unit.wire.strategies import PACKETS


@given(PACKETS)
def test_a_packet_of_ours_is_the_same_to_both_programs(packet: Packet) -> None:
    before = encode_packet(packet, version=OURS)
    with next_version():
        assert encode_packet(packet, version=OURS) == before
        assert decode_packet(before, version=OURS) == packet


@given(PACKETS)
def test_a_field_more_is_read_by_who_knows_it_and_passed_over_by_who_does_not(packet: Packet) -> None:
    with next_version() as met:
        told = encode_packet(packet, version=NEXT)
        assert decode_packet(told, version=NEXT) == packet
        assert met == {type(packet).__name__: 1}
    assert msgpack.unpackb(told, strict_map_key=False)[-1] == ADDED
    assert decode_packet(told, version=NEXT) == packet, "our program, on a connection of a version that it takes and does not know"
    with pytest.raises(MalformedPacket, match="fields"):
        decode_packet(told, version=OURS)


def test_a_packet_that_is_new_is_refused_as_not_supported() -> None:
    with next_version():
        told = encode_packet(Wave("hello", request_id=7), version=NEXT)
        assert decode_packet(told, version=NEXT) == Wave("hello", request_id=7)
        with pytest.raises(MalformedPacket) as breach:
            decode_packet(told, version=OURS)
    assert not isinstance(breach.value, UnsupportedPacket), "who agreed on our version has no business to send it"
    with pytest.raises(UnsupportedPacket, match=r"not supported: 200 is no packet of version 1") as unknown:
        decode_packet(told, version=NEXT)
    assert unknown.value.request_id == 7


@pytest.mark.parametrize("encode", [encode_packet, encode_frame])
def test_a_packet_that_is_new_is_not_sent_to_who_cannot_know_it(encode: Any) -> None:
    with next_version():
        with pytest.raises(NotSpoken, match=r"not supported: Wave is no packet of version 1") as refused:
            encode(Wave("hello"), version=OURS)
        encode(Wave("hello"), version=NEXT)
    assert isinstance(refused.value, Refused)
    assert refused.value.reason is RejectReason.ILL_FORMED, "as the peer itself would refuse it"


@dataclass(frozen=True, slots=True)
class Grown(Packet):
    """A packet that grew."""

    TYPE = 250
    first: int
    second: int = 5


GROWN = {250: row(Grown, Carrier.TCP_LOW, ("first", U32), ("second", Since(U32, 2)))}


def test_a_field_that_came_later_has_its_default_where_there_was_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(codec, "_LAYOUTS", {version: codec.layouts_of(GROWN, version) for version in (1, 2)})
    monkeypatch.setattr(codec, "PROTOCOL_VERSION", 2)
    monkeypatch.setattr(codec, "ROWS", GROWN)
    grown = Grown(1, 9, request_id=3)
    assert decode_packet(encode_packet(grown, version=2), version=2) == grown
    assert decode_packet(encode_packet(grown, version=1), version=1) == replace(grown, second=5)
    with pytest.raises(MalformedPacket):
        decode_packet(encode_packet(grown, version=1), version=2)


@dataclass(frozen=True, slots=True)
class Careless(Packet):
    TYPE = 251
    first: int
    second: int


@pytest.mark.parametrize(
    "fields",
    [[("first", U32), ("second", Since(U32, 2))], [("first", Since(U32, 2)), ("second", U32)]],
    ids=["without a default", "in front of an older one"],
)
def test_a_table_says_what_a_field_is_where_it_is_not(fields: list[tuple[str, Any]]) -> None:
    with pytest.raises(AssertionError):
        row(Careless, Carrier.TCP_LOW, *fields)


def test_what_counts_here_is_what_the_tables_say() -> None:
    with next_version():
        assert all(isinstance(layout, Longer) for layout in codec._LAYOUTS[NEXT].values())
    assert codec._LAYOUTS.keys() == set(range(1, OURS + 1))
    assert decode_packet(encode_packet(Fault(RejectReason.BUSY, "x", request_id=1))) == Fault(RejectReason.BUSY, "x", request_id=1)


@given(st.integers(OURS, 65_535))
def test_of_any_later_version_what_is_ours_is_understood(version: int) -> None:
    fault = Fault(RejectReason.BUSY, "x", request_id=1)
    assert decode_packet(encode_packet(fault, version=version), version=version) == fault
