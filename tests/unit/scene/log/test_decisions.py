"""If this fails, something is believed of a scene's header, or of its log, that the node that decides never signed."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.base.errors import DamagedData, Refused
from scenefold.client.births import verified_header_key
from scenefold.crypto import SigningKey
from scenefold.peer.scene_log.headers import checked_header
from scenefold.scene.log import Undecided, check_decided, check_log, decided, keys_after
from scenefold.wire import MalformedPacket, Role, SceneLogPublic
from unit.scene.log.members import grant
from unit.scene.log.test_grants import KEEPER_KEY, Story


def grown() -> Story:
    """A scene with members, key epochs and a succession: everything that a header can hold."""
    story = Story()
    story.do(grant(1, Role.WRITER))
    story.do(grant(5, Role.OWNER))
    story.revoke(5)
    return story


STORY = grown()
ENCODED = STORY.header.encode()
BITS = 8 * len(ENCODED)


def refused(data: bytes) -> str:
    """The words by which what was a good header is refused, by nodes and clients alike."""
    try:
        header = SceneLogPublic.decode(data)
    except MalformedPacket as problem:
        return str(problem)
    with pytest.raises(Refused) as by_nodes:
        checked_header(header, None)
    with pytest.raises(Refused):
        checked_header(header, STORY.known)
    with pytest.raises(DamagedData) as by_clients:
        verified_header_key(header)
    with pytest.raises(DamagedData):
        keys_after(header, STORY.first_keys, None)
    return f"{by_nodes.value.what} / {by_clients.value.what}"


def flipped(data: bytes, bit: int) -> bytes:
    bent = bytearray(data)
    bent[bit // 8] ^= 1 << bit % 8
    return bytes(bent)


def test_any_bit_of_a_decision_counts() -> None:
    decision = STORY.header.decision
    assert decision is not None
    # The decision stands at the end: its form, one certificate, and the lengths of both.
    for bit in range(BITS - 8 * (len(decision.certificates[0]) + 5), BITS):
        assert len(refused(flipped(ENCODED, bit))) > 10


@settings(max_examples=300, deadline=None)
@given(st.integers(0, BITS - 1))
def test_any_bit_of_a_header_counts(bit: int) -> None:
    assert len(refused(flipped(ENCODED, bit))) > 10


def test_any_bit_of_a_sealed_log_counts() -> None:
    dice = random.Random(1)
    check_log(STORY.header, STORY.private)
    for bit in dice.sample(range(8 * len(STORY.private)), 300):
        with pytest.raises(DamagedData, match="not the one that its header names"):
            check_log(STORY.header, flipped(STORY.private, bit))
    for other in (b"", STORY.private[:-1], STORY.private + b"\0"):
        with pytest.raises(DamagedData, match="not the one that its header names"):
            check_log(STORY.header, other)


@settings(max_examples=30, deadline=None)
@given(st.binary(min_size=32, max_size=32).map(SigningKey))
def test_nobody_else_decides(stranger: SigningKey) -> None:
    with pytest.raises(Undecided, match="not decided by the node"):
        check_decided(decided(STORY.header, stranger))
    with pytest.raises(Undecided, match="proposed"):
        check_decided(STORY.header.proposed())


def test_a_decision_changes_nothing_that_was_signed_and_is_the_same_each_time() -> None:
    header = STORY.header
    assert decided(header.proposed(), KEEPER_KEY) == header
    assert header.proposed().signable() == header.signable() == replace(header, signature=bytes(64)).signable()
    assert header.with_genesis().genesis != header.genesis, "only a first header gives its genesis"


def test_a_first_header_is_the_same_each_time_it_is_made() -> None:
    """A creation that was interrupted announces the same again, its sealed log with it."""
    one, other = Story(), Story()
    assert (one.header, one.private) == (other.header, other.private)
    check_log(one.header, one.private)
    assert one.header.with_genesis() == one.header


def test_what_is_signed_of_a_header_follows_what_it_says_and_not_by_whom_it_was_decided() -> None:
    header = STORY.header
    before = header.signable()
    assert header.proposed().decision is None and header.proposed().signable() == before
    assert header.proposed().decided_by(header.decision) == header
    changed = replace(header, write_floor=header.write_floor + 1)
    assert changed.signable() != before and changed.proposed().signable() == changed.signable()
