"""If this fails, a stranger can speak as a node, or an old datagram passes for a new one."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import DamagedData, LocalFault
from scenefold.base.ids import NodeId
from scenefold.crypto import (
    DATAGRAM_OVERHEAD_BYTES,
    InvalidSignature,
    ReplayWindow,
    SigningKey,
    StrangeVersion,
    datagram_counter,
    parse_datagram,
    sign_datagram,
    verify_datagram,
)

KEY = SigningKey.from_seed(b"n" * 32)
SENDER = NodeId(2130706434)


@given(st.binary(max_size=200), st.integers(0, 2**64 - 1), st.integers(0, 2**32 - 1))
def test_round_trip(payload: bytes, counter: int, target: int) -> None:
    data = sign_datagram(KEY, SENDER, counter, payload, target=NodeId(target))
    assert len(data) == DATAGRAM_OVERHEAD_BYTES + len(payload)
    datagram = parse_datagram(data)
    assert (datagram.sender, datagram.counter, datagram.target) == (SENDER, counter, target)
    assert verify_datagram(datagram, KEY.public) == payload


def test_any_changed_byte_is_noticed() -> None:
    whole = sign_datagram(KEY, SENDER, 5, b"status")
    for at in range(len(whole)):
        changed = bytearray(whole)
        changed[at] ^= 1
        with pytest.raises(DamagedData):
            verify_datagram(parse_datagram(bytes(changed)), KEY.public)


@given(st.binary(max_size=200))
def test_any_bytes(data: bytes) -> None:
    with pytest.raises(DamagedData):
        verify_datagram(parse_datagram(data), KEY.public)


@given(st.binary(min_size=4, max_size=4))
def test_only_its_own_version_passes_and_others_of_the_family_are_named(head: bytes) -> None:
    whole = sign_datagram(KEY, SENDER, 5, b"status")
    for magic in (head, b"SFD" + head[:1]):
        data = magic + whole[4:]
        if data == whole:
            continue
        with pytest.raises(DamagedData) as caught:
            parse_datagram(data)
        assert isinstance(caught.value, StrangeVersion) == (magic[:3] == b"SFD" and magic[3:].isdigit())


@pytest.mark.parametrize("digit", [b"0", b"2", b"9"])
def test_a_forged_version_is_not_verified_but_told(digit: bytes) -> None:
    """Also without its end: a later version may be shorter than ours."""
    whole = sign_datagram(KEY, SENDER, 5, b"status")
    for data in (b"SFD" + digit + whole[4:], b"SFD" + digit):
        with pytest.raises(StrangeVersion, match=f"of version {digit.decode()} of the protocol, this node takes version 1"):
            parse_datagram(data)


def test_another_key_and_a_cut() -> None:
    whole = sign_datagram(KEY, SENDER, 5, b"status")
    with pytest.raises(InvalidSignature):
        verify_datagram(parse_datagram(whole), SigningKey.generate().public)
    with pytest.raises(InvalidSignature):
        verify_datagram(parse_datagram(whole[:-1]), KEY.public)
    with pytest.raises(LocalFault):
        sign_datagram(KEY, SENDER, 1 << 64, b"")


def test_a_boot_later_counts_higher() -> None:
    assert datagram_counter(1, 2**32 - 1) < datagram_counter(2, 0) < datagram_counter(2, 1)


@given(st.lists(st.one_of(st.integers(0, 200), st.integers(0, 2**64 - 1)), max_size=80))
def test_no_counter_passes_twice_and_recent_ones_pass_once(counters: list[int]) -> None:
    window = ReplayWindow()
    seen: set[int] = set()
    for counter in counters:
        recent = not seen or counter > max(seen) - 64
        assert window.is_fresh(counter) == (counter not in seen and recent)
        if window.is_fresh(counter):
            window.accept(counter)
            seen.add(counter)


def test_asking_leaves_no_trace() -> None:
    window = ReplayWindow()
    assert window.is_fresh(1 << 60)
    assert window.is_fresh(0)
