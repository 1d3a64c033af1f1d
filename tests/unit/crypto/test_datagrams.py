"""If this fails, a stranger can speak as a node, or read or change what nodes say to each other."""

from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import DamagedData, LocalFault
from scenefold.base.ids import NodeId
from scenefold.crypto import SALT_BYTES, SEALED_OVERHEAD_BYTES, WINDOW_BITS, DatagramKey, ReplayWindow, SealingKey, StrangeVersion, head_of

ADA, BOB = NodeId(2130706434), NodeId(2130706435)
KEYS = {ADA: SealingKey(b"a" * 32), BOB: SealingKey(b"b" * 32)}
SECRET = KEYS[ADA].agree(KEYS[BOB].public)
CLUSTER, SALT = b"c" * 16, b"s" * SALT_BYTES
KEY = DatagramKey(SECRET, CLUSTER, 1, ADA, BOB, SALT)


def opened(data: bytes, key: DatagramKey = KEY) -> bytes:
    head_of(data)
    return key.open(data)


@given(st.binary(max_size=200), st.integers(0, 2**64 - 1), st.binary(min_size=16, max_size=16))
def test_round_trip_from_either_end(content: bytes, counter: int, salt: bytes) -> None:
    data = DatagramKey(SECRET, CLUSTER, 0, ADA, BOB, salt).seal(counter, content)
    assert len(data) == SEALED_OVERHEAD_BYTES + len(content)
    assert head_of(data) == (ADA, BOB, salt, counter)
    there = DatagramKey(KEYS[BOB].agree(KEYS[ADA].public), CLUSTER, 0, ADA, BOB, salt)
    assert there.open(data) == content
    assert len(content) < 6 or content not in data[36:]


def test_every_changed_bit_is_noticed() -> None:
    whole = KEY.seal(5, b"\x01a status")
    for bit in range(8 * len(whole)):
        changed = bytearray(whole)
        changed[bit // 8] ^= 1 << bit % 8
        with pytest.raises(DamagedData):
            opened(bytes(changed))


def test_ten_thousand_changed_bits_of_any_datagram_are_noticed() -> None:
    dice = random.Random(7)
    for _ in range(10_000):
        whole = bytearray(KEY.seal(dice.getrandbits(64), dice.randbytes(dice.randrange(1, 1300))))
        bit = dice.randrange(8 * len(whole))
        whole[bit // 8] ^= 1 << bit % 8
        with pytest.raises(DamagedData):
            opened(bytes(whole))


@given(st.binary(max_size=200))
def test_any_bytes(data: bytes) -> None:
    with pytest.raises(DamagedData):
        opened(data)


def test_a_key_is_of_one_cluster_port_direction_boot_and_pair() -> None:
    whole = KEY.seal(5, b"status")
    carol = SealingKey(b"d" * 32)
    others = [
        DatagramKey(carol.agree(KEYS[BOB].public), CLUSTER, 1, ADA, BOB, SALT),
        DatagramKey(SECRET, b"d" * 16, 1, ADA, BOB, SALT),
        DatagramKey(SECRET, CLUSTER, 0, ADA, BOB, SALT),
        DatagramKey(SECRET, CLUSTER, 1, BOB, ADA, SALT),
        DatagramKey(SECRET, CLUSTER, 1, ADA, NodeId(BOB + 1), SALT),
        DatagramKey(SECRET, CLUSTER, 1, ADA, BOB, b"t" * SALT_BYTES),
    ]
    for other in others:
        with pytest.raises(DamagedData):
            other.open(whole)
    assert len({other.seal(5, b"status")[SEALED_OVERHEAD_BYTES - 16 :] for other in [*others, KEY]}) == len(others) + 1


def test_a_cut_and_a_counter_that_is_none() -> None:
    whole = KEY.seal(5, b"status")
    for length in range(len(whole)):
        with pytest.raises(DamagedData):
            opened(whole[:length])
    with pytest.raises(LocalFault):
        KEY.seal(1 << 64, b"")


@given(st.binary(min_size=4, max_size=4))
def test_only_its_own_version_passes_and_others_of_the_family_are_named(head: bytes) -> None:
    whole = KEY.seal(5, b"status")
    for magic in (head, b"SFD" + head[:1]):
        data = magic + whole[4:]
        if data == whole:
            continue
        with pytest.raises(DamagedData) as caught:
            head_of(data)
        assert isinstance(caught.value, StrangeVersion) == (magic[:3] == b"SFD" and magic[3:].isdigit())


@pytest.mark.parametrize("digit", [b"0", b"1", b"9"])
def test_another_version_is_not_opened_but_told(digit: bytes) -> None:
    """Also without its end: a later version may be shorter than ours."""
    whole = KEY.seal(5, b"status")
    for data in (b"SFD" + digit + whole[4:], b"SFD" + digit):
        with pytest.raises(StrangeVersion, match=f"of version {digit.decode()}, this node takes version 2"):
            head_of(data)


@given(st.lists(st.one_of(st.integers(0, 3 * WINDOW_BITS), st.integers(0, 2**64 - 1)), max_size=80), st.integers(0, 2000))
def test_no_counter_passes_twice_and_recent_ones_pass_once(counters: list[int], seen_below: int) -> None:
    window = ReplayWindow(seen_below)
    seen: set[int] = set()
    for counter in counters:
        recent = counter > max(seen, default=seen_below - 1) - WINDOW_BITS
        assert window.is_fresh(counter) == (counter not in seen and counter >= seen_below and recent)
        if window.is_fresh(counter):
            window.accept(counter)
            seen.add(counter)


def test_asking_leaves_no_trace() -> None:
    window = ReplayWindow()
    assert window.is_fresh(1 << 60)
    assert window.is_fresh(0)
