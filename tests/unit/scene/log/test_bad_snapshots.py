"""If this fails, a key holder's mistake or malice in a snapshot passes for a scene's past, or ends in a traceback."""

from __future__ import annotations

import struct
from contextlib import suppress
from dataclasses import fields, replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.ids import SpaceId
from scenefold.base.limits import LOG_BYTES_MAX
from scenefold.base.location import FIRST, Location
from scenefold.crypto import SNAPSHOT_DOMAIN, SigningKey, seal_log
from scenefold.scene.log import FOR_EVER, OpenedLog, SceneLog, cut_at, open_private, packed_state, sign_snapshot, unpacked_state
from scenefold.scene.log.space import Step
from scenefold.scene.log.states import packed_steps
from scenefold.wire import (
    AddObserver,
    AddParticipant,
    Batch,
    CreateSpace,
    CurveKind,
    KeyEpoch,
    MalformedPacket,
    Revoke,
    Role,
    ScaleSpace,
    SceneMode,
    SetCopies,
    SetMode,
    ShortenedLog,
    SignedSnapshot,
    SnapshotState,
    TranslateSpace,
    WriterEntry,
)
from unit.scene.log.council import node
from unit.scene.log.members import grant, secrets_of
from unit.scene.log.random_logs import GENESIS, HEADER_KEY, KEY, ORIGIN, RECORDS, WISHES, entry_of, opening, records_by, sealed, whole

HALL, SHADE = SpaceId(11), SpaceId(12)
MADE = CreateSpace(HALL, 3, CurveKind.HILBERT, False, SpaceId(0), FIRST, 2, 1, False, "hall", (0.0,) * 3, (8.0,) * 3)
SHADOW = replace(MADE, space=SHADE, name="hall copy 1", parent=HALL, offset=Location.from_number(1 << 159), copies=1)
LOG = whole(
    records_by(
        [
            Batch((MADE, SHADOW)),
            TranslateSpace(HALL, (1.0, 2.0, 3.0)),
            ScaleSpace(HALL, 0.5),
            grant(1, Role.OWNER),
            Batch((Revoke(secrets_of(1).signing.key_id), KeyEpoch(1, b"k" * 24))),
            grant(2, Role.WRITER),
            [
                AddParticipant(node(1).member, node(1).key),
                AddParticipant(node(2).member, node(2).key),
                AddObserver(node(3).member, node(3).key),
            ],
            SetCopies(HALL, 1, 1),
            SetMode(SceneMode.RENDER),
            SetMode(SceneMode.EDIT),
            SetMode(SceneMode.EDIT),
        ]
    )
)
CUT = 10
SHORT = cut_at(LOG, CUT, GENESIS, HEADER_KEY)
assert LOG.state.position == 12 and SHORT.snapshot is not None
STATE = SnapshotState.decode(SHORT.snapshot.state)


def signed(state: bytes, key: SigningKey = HEADER_KEY, genesis: bytes = GENESIS) -> SignedSnapshot:
    return SignedSnapshot(state, key.sign(SNAPSHOT_DOMAIN, genesis + state))


def refused(log: OpenedLog, match: str, **told: Any) -> None:
    assert log.snapshot is not None
    plain = ShortenedLog(log.snapshot, log.records).encode()
    private = seal_log(plain, genesis=GENESIS, position=12, symmetric_key=KEY, key_epoch=0, nonce=bytes(12), shortened=True)
    with pytest.raises(DamagedData, match=match):
        open_private(private, **{**opening(LOG), **told})


def test_the_log_that_these_tests_spoil_is_good() -> None:
    assert open_private(sealed(SHORT), **opening(LOG)) == SHORT
    assert unpacked_state(SHORT.snapshot.state if SHORT.snapshot else b"").position == CUT


def test_a_snapshot_counts_by_the_word_of_its_scenes_header_key_alone() -> None:
    assert SHORT.snapshot is not None
    for snapshot in (
        signed(SHORT.snapshot.state, SigningKey(bytes(32))),
        signed(SHORT.snapshot.state, genesis=bytes(32)),
        replace(SHORT.snapshot, signature=HEADER_KEY.sign(b"scenefold/log", GENESIS + SHORT.snapshot.state)),
        replace(SHORT.snapshot, signature=bytes(64)),
        SignedSnapshot(packed_state(replace(LOG.state, mode=SceneMode.RENDER)), SHORT.snapshot.signature),
    ):
        for known in (None, SHORT, LOG):
            refused(replace(SHORT, snapshot=snapshot), "the signature is not that of key", known=known)
    refused(SHORT, "the signature is not that of key", header_key=SigningKey(bytes(32)).public)


@pytest.mark.parametrize("at", [1, 9, 11, 12])
def test_a_snapshot_of_another_position_is_followed_by_nothing(at: int) -> None:
    other = cut_at(LOG, at, GENESIS, HEADER_KEY).snapshot if at < 12 else sign_snapshot(LOG.state, GENESIS, HEADER_KEY)
    refused(replace(SHORT, snapshot=other), f"does not follow position {at}")


def test_something_stands_behind_it() -> None:
    alone = OpenedLog(LOG.state, (), sign_snapshot(LOG.state, GENESIS, HEADER_KEY))
    refused(alone, "no record stands behind its snapshot")


def test_what_stands_behind_it_follows() -> None:
    first, second = SHORT.records
    refused(replace(SHORT, records=(second,)), "does not follow position 10")
    refused(replace(SHORT, records=(first, first)), "does not follow position 11")
    refused(replace(SHORT, records=(first, replace(second, signature=bytes(64)))), "the signature is not that of key")
    refused(replace(SHORT, records=(first,)), "ends at position 11")
    repeated = whole([one.decoded() for one in LOG.records[:-1]])
    state = repeated.state
    record = replace(state.next_record(SetMode(SceneMode.EDIT), LOG.records[3].decoded().request_id, ORIGIN))
    again = replace(
        SHORT, records=(first, replace(second, record=record.encode(), signature=HEADER_KEY.sign(b"scenefold/log", record.encode())))
    )
    refused(again, "this request is in the log already, at position 4")


def test_what_is_cut_off_or_sealed_otherwise_is_no_log() -> None:
    private = sealed(SHORT)
    for broken in (private[:-1], private[:20], b"\1" + private[1:], b"\2" + sealed(LOG)[1:]):
        with pytest.raises(DamagedData):
            open_private(broken, **opening(LOG))
    with pytest.raises(DamagedData, match="a sealed log of version 3, suite 1") as caught:
        open_private(b"\3" + private[1:], **opening(LOG))
    assert caught.value.remedy == "update this program"
    assert SHORT.snapshot is not None
    plain = ShortenedLog(SHORT.snapshot, SHORT.records).encode()
    for inside in (plain[:-1], plain + b"\0", plain[:40], b"", bytes(LOG_BYTES_MAX + 1)):
        for shortened in (False, True):
            wrong = seal_log(inside, genesis=GENESIS, position=12, symmetric_key=KEY, key_epoch=0, nonce=bytes(12), shortened=shortened)
            with pytest.raises(DamagedData):
                open_private(wrong, **opening(LOG))


@given(st.binary(max_size=400))
def test_whatever_was_sealed_as_a_shortened_log_is_one_or_damaged(plain: bytes) -> None:
    private = seal_log(plain, genesis=GENESIS, position=3, symmetric_key=KEY, key_epoch=0, nonce=bytes(12), shortened=True)
    with pytest.raises(DamagedData):
        open_private(private, genesis=GENESIS, position=3, symmetric_key=KEY, header_key=HEADER_KEY.public)


def spaces(**changes: Any) -> dict[str, Any]:
    """The state's spaces, the hall's or its shadow's changed."""
    number = changes.pop("of", HALL)
    return {"spaces": tuple(replace(one, **changes) if one.space.space == number else one for one in STATE.spaces)}


def hall(**changes: Any) -> dict[str, Any]:
    number = changes.pop("of", HALL)
    return spaces(of=number, space=next(replace(one.space, **changes) for one in STATE.spaces if one.space.space == number))


def steps(*rows: tuple[int, float, tuple[float, ...]]) -> bytes:
    return packed_steps([Step(*row) for row in rows], 3)


def term(index: int, **changes: Any) -> dict[str, Any]:
    return {"writers": tuple(replace(one, **changes) if at == index else one for at, one in enumerate(STATE.writers))}


NOWHERE = (0.0,) * 3
WRONG: dict[str, dict[str, Any]] = {
    "no spaces": {"spaces": ()},
    "spaces out of order": {"spaces": STATE.spaces[::-1]},
    "a shadow before its parent": {"spaces": (*STATE.spaces[:-2], STATE.spaces[-1], STATE.spaces[-2])},
    "a space twice": {"spaces": (*STATE.spaces, STATE.spaces[-1])},
    "a name twice": hall(name="hall", of=SHADE),
    "a space without a name": hall(name=""),
    "more copies needed than wanted": hall(copies_min=3),
    "a shadow of nothing": hall(parent=SpaceId(99), of=SHADE),
    "a shadow of another shape": hall(high=(9.0,) * 3, of=SHADE),
    "a shadow that moved": spaces(of=SHADE, steps=steps((4, 2.0, NOWHERE))),
    "a shadow that turned": spaces(of=SHADE, turned=9),
    "a space that nodes manage moved": hall(node_managed=True),
    "created never": spaces(created=11, steps=b""),
    "created after a step": spaces(created=4),
    "turned never": spaces(turned=11),
    "turned before it was there": spaces(turned=1),
    "steps cut off": spaces(steps=steps((3, 2.0, NOWHERE))[:-1]),
    "steps out of order": spaces(steps=steps((4, 2.0, NOWHERE), (3, 2.0, NOWHERE))),
    "a step to come": spaces(steps=steps((11, 2.0, NOWHERE))),
    "a step before the creation": spaces(steps=steps((1, 2.0, NOWHERE))),
    "a step that does both": spaces(steps=steps((4, 2.0, (0.0, 1.0, 0.0)))),
    "a step by nothing": spaces(steps=steps((4, 0.0, NOWHERE))),
    "a step backwards": spaces(steps=steps((4, -1.0, NOWHERE))),
    "a step without end": spaces(steps=steps((4, 1.0, (float("inf"), 0.0, 0.0)))),
    "a step by no number": spaces(steps=steps((4, float("nan"), NOWHERE))),
    "a scale without end": spaces(steps=steps((4, float("inf"), NOWHERE))),
    "a space that is too far off": spaces(steps=steps((4, 1.0, (1e15, 0.0, 0.0)))),
    "no members": {"members": ()},
    "no owner": {"members": (replace(STATE.members[0], grant=replace(STATE.members[0].grant, role=Role.WRITER)), *STATE.members[1:])},
    "a member twice": {"members": (*STATE.members, STATE.members[-1])},
    "a member without a name": {"members": (replace(STATE.members[0], grant=replace(STATE.members[0].grant, name="")), *STATE.members[1:])},
    "a member to come": {"members": (*STATE.members[:-1], replace(STATE.members[-1], position=11))},
    "a writer whose term ended": term(2, until_position=9),
    "a term that never ended": term(1, until_position=FOR_EVER),
    "a term that ends in the future": term(1, until_position=10),
    "a term that ends before it begins": term(1, until_position=3),
    "a term from nowhere": term(0, from_position=0),
    "terms out of order": {"writers": STATE.writers[::-1]},
    "a term of nobody's": {"writers": (*STATE.writers, WriterEntry(secrets_of(9).signing.key_id, 8, 8))},
    "a key without a term": {"writer_keys": (*STATE.writer_keys, grant(9).signing)},
    "a key twice": {"writer_keys": (*STATE.writer_keys, STATE.writer_keys[0])},
    "a key that is none": {"writer_keys": (*STATE.writer_keys[:-1], replace(STATE.writer_keys[-1], raw=b"\xff" * 32))},
    "a key of no suite": {"writer_keys": (replace(STATE.writer_keys[0], suite=9), *STATE.writer_keys[1:])},
    "former keys cut off": {"former_keys": STATE.former_keys[:-1]},
    "an epoch without a change": {"former_keys": b""},
    "a change of key to come": {"keyed_at": 11},
    "a header key to come": {"header_keyed_at": 11},
    "a header key that did not change": {"header_keys": 0},
    "a header key that changed too often": {"header_keys": 65},
    "revoked without another key": {"revoked_at": 7},
    "a floor to come": {"write_floor": 11},
    "a floor below a revocation": {"write_floor": 5},
    "a purge above the floor": {"purged": 11},
    "requests cut off": {"requests": STATE.requests[:-1]},
    "a request too few": {"requests": STATE.requests[16:]},
    "a request too many": {"requests": bytes(16) + STATE.requests},
    "a request twice": {"requests": STATE.requests[:16] + STATE.requests[:-16]},
    "participants out of order": {"participants": STATE.participants[::-1]},
    "a node that takes part twice": {"observers": STATE.participants[:1]},
}


@pytest.mark.parametrize("changes", WRONG.values(), ids=WRONG)
def test_a_state_that_no_log_comes_to_is_refused(changes: dict[str, Any]) -> None:
    state = replace(STATE, **changes).encode()
    with pytest.raises((Refused, DamagedData)):
        unpacked_state(state)
    refused(replace(SHORT, snapshot=signed(state)), "does not hold together")


LIES: dict[str, tuple[dict[str, Any], str]] = {
    "head": ({"head": bytes(32)}, "does not follow position 10"),
    "header key": ({"header_keys": 0, "header_keyed_at": 1}, "tell otherwise of the header key"),
    "position": ({"position": 11, "requests": STATE.requests + b"x" * 16}, "does not follow position 11"),
}


@pytest.mark.parametrize(("changes", "match"), LIES.values(), ids=LIES)
def test_a_state_that_contradicts_what_comes_with_it_is_refused(changes: dict[str, Any], match: str) -> None:
    refused(replace(SHORT, snapshot=signed(replace(STATE, **changes).encode())), match)


@given(RECORDS, st.data())
@settings(max_examples=60, deadline=None)
def test_spoilt_states_are_refused_or_have_exactly_these_bytes(records: list[Any], data: st.DataObject) -> None:
    state = bytearray(packed_state(whole(records[:-1]).state))
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(state) - 1))
        state[at : at + data.draw(st.integers(0, 2))] = data.draw(st.binary(max_size=2))
    try:
        found = unpacked_state(bytes(state))
    except (MalformedPacket, DamagedData, Refused):
        return
    assert packed_state(found) == state


@given(RECORDS, RECORDS, st.sets(st.sampled_from([field.name for field in fields(SnapshotState)])), st.lists(WISHES, max_size=6))
@settings(max_examples=30, deadline=None)
def test_what_is_taken_folds_on_as_any_other_state(one: list[Any], other: list[Any], names: set[str], wishes: list[Any]) -> None:
    """States put together of two logs' parts: those that are taken lead to such as can be written, read and asked again."""
    mine, theirs = (SnapshotState.decode(packed_state(SceneLog.of(records))) for records in (one, other))
    try:
        log = unpacked_state(replace(mine, **{name: getattr(theirs, name) for name in names}).encode())
    except (DamagedData, Refused):
        return
    for wish in wishes:
        with suppress(Refused):
            log = log.extended((log.next_record(entry_of(log, wish), log.position.to_bytes(16, "big"), ORIGIN),))
    assert unpacked_state(packed_state(log)) == log
    assert [space.document() for space in log.spaces.values()]


def test_rows_of_steps_are_what_they_are() -> None:
    assert packed_steps([Step(3, 1.0, (0.5,)), Step(4, 2.0, (0.0,))], 1) == struct.pack(">QddQdd", 3, 1.0, 0.5, 4, 2.0, 0.0)
