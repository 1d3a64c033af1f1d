"""If this fails, what one node says to another of a proposal arrives as something else."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.base.ids import NodeId
from scenefold.base.limits import (
    DECIDED_MAX,
    DECIDERS_MAX,
    FRAME_BYTES_MAX,
    LOG_BODY_BYTES_MAX,
    LOG_BYTES_MAX,
    LOG_RECORD_BYTES_MAX,
    LOG_VALUE_BYTES_MAX,
)
from scenefold.consensus import AskLog, Certificate, Learn, Value
from scenefold.consensus.packets import decided_page, decided_value, messages_of, packet_of, pages_of, scene_of
from scenefold.wire import (
    Ballot,
    DecidedValue,
    MalformedPacket,
    Member,
    Packet,
    Promise,
    ProposeValue,
    Release,
    RequestSceneLog,
    RequestState,
    RespondSceneLog,
    Vote,
    Want,
    decode_packet,
    encode_packet,
)
from unit.consensus.logs_made import GENESIS, member
from unit.wire.strategies import packets_of
from unit.wire.vectors import example_packet

BALLOT = Ballot(3, NodeId(2))


def vote(node: int, value: Value, position: int = 5) -> Vote:
    return Vote(position, BALLOT, value.digest, member(node), bytes([node]) * 64)


def learn(position: int, data: bytes = b"value", body: bytes = b"body") -> Learn:
    value = Value(data, body)
    return Learn(GENESIS, position, value, Certificate(position, BALLOT, (vote(1, value, position), vote(2, value, position))))


@pytest.mark.parametrize("number", [7, 8, 9])
def test_what_packets_say_is_what_messages_say(number: int) -> None:
    @settings(max_examples=50, deadline=None)
    @given(packets_of(number))
    def check(packet: Packet) -> None:
        (message,) = messages_of(decode_packet(encode_packet(packet)))
        again = packet_of(message)
        assert encode_packet(again) == encode_packet(replace(packet, request_id=0, mini_status=None))
        assert messages_of(again) == (message,)

    check()


@given(st.integers(0, 2**64 - 1))
def test_who_asks_says_what_it_has(have: int) -> None:
    packet = decode_packet(encode_packet(packet_of(AskLog(GENESIS, have))))
    assert messages_of(packet) == (AskLog(GENESIS, have),)
    assert scene_of(GENESIS) == int.from_bytes(GENESIS[:4], "big")


@given(st.integers(0, 2**64 - 1), st.binary(max_size=100), st.binary(max_size=100))
def test_what_is_decided_is_told_with_all_that_shows_it(position: int, data: bytes, body: bytes) -> None:
    told = learn(position, data, body)
    (heard,) = messages_of(decode_packet(encode_packet(packet_of(told))))
    assert heard == told
    assert isinstance(heard, Learn) and (heard.value.digest, heard.value.body) == (told.value.digest, body)


def test_what_is_about_something_else_says_nothing() -> None:
    assert messages_of(RequestState()) == messages_of(RespondSceneLog(None)) == ()
    example = example_packet(5)
    assert isinstance(example, RequestSceneLog)
    for want in set(Want) - {Want.DECIDED}:
        assert messages_of(replace(example, genesis=GENESIS, want=want)) == ()


def test_a_page_holds_as_many_as_fit_and_one_at_least() -> None:
    small = [decided_value(learn(position)) for position in range(6, 6 + 2 * DECIDED_MAX)]
    page = decided_page(GENESIS, 5 + 2 * DECIDED_MAX, small)
    assert page.decided == tuple(small[:DECIDED_MAX])
    large = [decided_value(learn(position, body=bytes(LOG_BYTES_MAX // 3))) for position in range(6, 10)]
    assert decided_page(GENESIS, 9, large).decided == tuple(large[:2])
    assert decided_page(GENESIS, 5, []).decided == ()
    value = Value(bytes(LOG_RECORD_BYTES_MAX), bytes(LOG_BODY_BYTES_MAX))
    votes = tuple(vote(node, value) for node in range(1, DECIDERS_MAX + 1))
    releases = tuple(Release(5, member(node), bytes(64)) for node in range(1, 161))
    huge = [DecidedValue(5, value, BALLOT, votes, releases)] * 2
    page = decided_page(GENESIS, 6, huge)
    assert len(page.decided) == 1
    assert len(encode_packet(RespondSceneLog(None, page))) < FRAME_BYTES_MAX


def test_the_largest_proposal_fits_a_frame() -> None:
    value = Value(bytes(LOG_RECORD_BYTES_MAX), bytes(LOG_BODY_BYTES_MAX))
    assert len(value.encode()) <= LOG_VALUE_BYTES_MAX
    other = Value(bytes(LOG_RECORD_BYTES_MAX - 1) + b"x", bytes(LOG_BODY_BYTES_MAX))
    far = 2**32 - 1
    nodes = range(far - DECIDERS_MAX, far)
    who = [Member(NodeId(node), bytes(16)) for node in nodes]
    promises = tuple(Promise(2**64 - 1, Ballot(far, NodeId(far)), Ballot(far, NodeId(far)), bytes(32), one, bytes(64)) for one in who)
    plain = example_packet(7)
    assert isinstance(plain, ProposeValue)
    packet = replace(plain, route=tuple(map(NodeId, nodes)), facts=promises, highest=value, value=other)
    assert decode_packet(encode_packet(packet)) == packet


@given(st.binary(max_size=300), st.binary(max_size=300))
def test_a_value_is_kept_with_both_its_parts(data: bytes, body: bytes) -> None:
    value = Value(data, body)
    kept = Value.decode(value.encode())
    assert (kept.data, kept.body, kept.digest) == (data, body, value.digest)
    assert kept == Value(data), "what is decided is the data"
    with pytest.raises(MalformedPacket):
        Value.decode(value.encode() + b"\0")


def test_what_is_told_at_once_is_told_in_as_many_packets_as_it_takes() -> None:
    learns = [learn(position, body=bytes(LOG_BYTES_MAX // 3)) for position in range(6, 11)]
    packets = list(pages_of(learns))
    assert [len(messages_of(packet)) for packet in packets] == [2, 2, 1]
    assert [message for packet in packets for message in messages_of(packet)] == learns
    assert all(isinstance(packet, RespondSceneLog) and packet.decided is not None and packet.decided.newest == 10 for packet in packets)
    assert list(pages_of([])) == []
