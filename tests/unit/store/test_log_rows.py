"""If this fails, a node reads its votes as something else than it has said: two histories of one log."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import DamagedData
from scenefold.base.ids import NodeId
from scenefold.base.limits import DECIDERS_MAX, LOG_BODY_BYTES_MAX, LOG_EXPOSED_MAX, LOG_RECORD_BYTES_MAX, LOG_VALUE_BYTES_MAX
from scenefold.consensus import Certificate, Slot, Tentative, Value, Vote
from scenefold.store.layout import LOGS
from scenefold.store.log_rows import (
    Decided,
    Votes,
    decided_key,
    log_named,
    pack_decided,
    pack_votes,
    position_of,
    unpack_decided,
    unpack_votes,
)
from scenefold.store.sealing import sealed
from scenefold.wire import Ballot, Member
from unit.store.log_samples import GENESIS, LIFE, PATH, ROWS, decided, made, packed, slot

U32, U64 = st.integers(0, 2**32 - 1), st.integers(1, 2**64 - 1)
BALLOTS = st.builds(lambda counter, node: Ballot(counter, NodeId(node)), st.integers(1, 2**32 - 1), U32)
VALUES = st.builds(Value, st.binary(max_size=40), st.binary(max_size=40))
LIVES = st.binary(min_size=16, max_size=16)


@st.composite
def slots(draw: st.DrawFn) -> Slot:
    low, high = sorted((draw(BALLOTS), draw(BALLOTS)))
    tentative = draw(st.one_of(st.none(), st.builds(Tentative, st.just(low), VALUES)))
    exposed = draw(st.frozensets(st.binary(min_size=32, max_size=32), max_size=5))
    return draw(st.sampled_from([Slot(), Slot(high, tentative, exposed)]))


@st.composite
def decisions(draw: st.DrawFn) -> Decided:
    position, ballot, value = draw(U64), draw(BALLOTS), draw(VALUES)
    members = draw(st.lists(st.builds(Member, U32.map(NodeId), LIVES), min_size=1, max_size=4))
    votes = tuple(Vote(position, ballot, value.digest, member, draw(st.binary(max_size=64))) for member in members)
    return Decided(position, value, Certificate(position, ballot, votes))


@given(LIVES, U64, slots(), st.integers(0, 2**64 - 1))
def test_votes_survive_their_bytes(life: bytes, position: int, what: Slot, silent: int) -> None:
    votes = Votes(life, position, what, silent)
    assert unpack_votes(GENESIS, memoryview(pack_votes(GENESIS, votes))) == votes


@given(decisions())
def test_what_is_decided_survives_its_bytes(what: Decided) -> None:
    assert unpack_decided(decided_key(GENESIS, what.position), memoryview(pack_decided(GENESIS, what))) == what


def test_the_golden_bytes() -> None:
    assert made() == json.loads(PATH.read_text(encoding="utf-8"))


def test_the_largest_rows() -> None:
    big = Value(bytes(LOG_RECORD_BYTES_MAX), bytes(LOG_BODY_BYTES_MAX))
    assert len(big.encode()) <= LOG_VALUE_BYTES_MAX
    exposed = frozenset(number.to_bytes(32, "big") for number in range(LOG_EXPOSED_MAX))
    votes = Votes(LIFE, 1, replace(slot(), accepted=Tentative(slot().promised, big), exposed=exposed))
    assert unpack_votes(GENESIS, memoryview(pack_votes(GENESIS, votes))) == votes
    most = decided(1, voters=DECIDERS_MAX)
    assert unpack_decided(decided_key(GENESIS, 1), memoryview(pack_decided(GENESIS, most))) == most


@pytest.mark.parametrize("name", ROWS)
def test_no_bit_turns_over_unnoticed_and_nothing_is_cut_off(name: str) -> None:
    row = ROWS[name]
    whole = packed(row)

    def read(stored: bytes) -> object:
        if isinstance(row, Votes):
            return unpack_votes(GENESIS, memoryview(stored))
        return unpack_decided(decided_key(GENESIS, row.position), memoryview(stored))

    assert read(whole) == row
    for bit in range(8 * len(whole)):
        damaged = bytearray(whole)
        damaged[bit // 8] ^= 1 << bit % 8
        with pytest.raises(DamagedData):
            read(bytes(damaged))
    for size in range(len(whole)):
        with pytest.raises(DamagedData):
            read(whole[:size])
    with pytest.raises(DamagedData):
        read(whole + b"\0")


def test_a_row_under_another_key_is_none() -> None:
    with pytest.raises(DamagedData, match="changed"):
        unpack_votes(bytes(32), memoryview(packed(ROWS["voted"])))
    with pytest.raises(DamagedData, match="changed"):
        unpack_decided(decided_key(GENESIS, 3), memoryview(packed(ROWS["decided by three"])))


@pytest.mark.parametrize(
    ("row", "why"),
    [
        (ROWS["voted"]._replace(position=0), "none"),  # type: ignore[union-attr]
        (ROWS["voted"]._replace(slot=replace(slot(), promised=Ballot(1, NodeId(1)))), "none"),  # type: ignore[call-arg, union-attr]
    ],
    ids=["no position", "voted above what was promised"],
)
def test_what_nobody_writes_is_damage_with_a_sound_checksum(row: Votes, why: str) -> None:
    with pytest.raises(DamagedData, match=why):
        unpack_votes(GENESIS, memoryview(pack_votes(GENESIS, row)))


def test_a_later_layout_is_not_guessed_at() -> None:
    body = packed(ROWS["voted"])[:-4]
    with pytest.raises(DamagedData, match="none"):
        unpack_votes(GENESIS, memoryview(sealed(LOGS, GENESIS, b"\2" + body[1:])))


def test_counts_beyond_the_bounds_are_damage() -> None:
    body = bytearray(packed(ROWS["nothing promised"])[:-4])
    body[49:51] = (LOG_EXPOSED_MAX + 1).to_bytes(2, "big")
    with pytest.raises(DamagedData, match="most"):
        unpack_votes(GENESIS, memoryview(sealed(LOGS, GENESIS, bytes(body))))
    body = bytearray(packed(ROWS["decided by one"])[:-4])
    body[9] = DECIDERS_MAX + 1
    key = decided_key(GENESIS, 1)
    with pytest.raises(DamagedData, match="most"):
        unpack_decided(key, memoryview(sealed(LOGS, key, bytes(body))))


def test_keys() -> None:
    assert position_of(decided_key(GENESIS, 7)) == 7 and position_of(GENESIS) == 0
    assert position_of(GENESIS + b"\0") is None and position_of(b"") is None
    assert log_named(GENESIS) == "votes of log 0001020304050607"
    assert log_named(decided_key(GENESIS, 7)) == "log 0001020304050607, position 7"
