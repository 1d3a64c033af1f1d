"""Logs of scenes by chance: whatever a fold takes may stand in them, what only early programs wrote, too."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from hypothesis import strategies as st

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId, SpaceId
from scenefold.base.location import FIRST, Location
from scenefold.crypto import SigningKey
from scenefold.scene.log import OpenedLog, SceneLog, first_record, seal_private, sign_record
from scenefold.wire import (
    AddObserver,
    AddParticipant,
    Batch,
    BeginPurge,
    CreateSpace,
    CurveKind,
    KeyEpoch,
    LogEntry,
    LogRecord,
    RemoveObserver,
    RemoveParticipant,
    RenderSettings,
    Revoke,
    Role,
    ScaleSpace,
    SceneMode,
    SetCopies,
    SetMode,
    TranslateSpace,
)
from unit.scene.log.council import node
from unit.scene.log.members import MAKER, grant, secrets_of

GENESIS = bytes(range(32))
ORIGIN = NodeId(7)
KEY = bytes(24)
HEADER_KEY = SigningKey(bytes(31) + b"\2")
SPACES = [SpaceId(number) for number in range(2, 18)]
_OFFSETS = [FIRST, *(Location.from_number(number) for number in (3, 5, 1 << 159))]
_NUMBERS = st.one_of(st.sampled_from([0.0, -0.0, 0.1, 1e9, -3.5, 5e-324]), st.floats(-1e6, 1e6))
_FACTORS = st.one_of(st.sampled_from([1.0, 2.0, 0.1, 3.0]), st.floats(0.2, 5.0))


@st.composite
def _created(draw: st.DrawFn) -> CreateSpace:
    dimensions, number = draw(st.integers(1, 4)), draw(st.sampled_from(SPACES))
    low = tuple(draw(st.floats(-10, 10)) for _ in range(dimensions))
    copies = draw(st.integers(1, 3))
    return CreateSpace(
        space=number,
        dimensions=dimensions,
        curve=draw(st.sampled_from(CurveKind)),
        node_managed=draw(st.booleans()),
        parent=SpaceId(0),
        offset=draw(st.sampled_from(_OFFSETS)),
        copies=copies,
        copies_min=draw(st.integers(1, copies)),
        render_output=draw(st.booleans()),
        name=f"space {number}",
        low=low,
        high=tuple(corner + 1.0 for corner in low),
    )


def _shadow(log: SceneLog, parent: SpaceId, number: SpaceId, offset: Location) -> LogEntry:
    """A shadow in the shape of a space that may be there."""
    found = log.spaces.get(parent)
    if found is None:
        return SetMode(SceneMode.EDIT)
    curve = CurveKind.Z_ORDER if found.curve == "z-order" else CurveKind.HILBERT
    made = CreateSpace(
        number, found.dimensions, curve, found.node_managed, parent, offset, 1, 1, False, f"space {number}", found.low, found.high
    )
    return replace(made, render_output=found.render_output)


def _move(log: SceneLog, space: SpaceId, by: list[float]) -> LogEntry:
    dimensions = log.spaces[space].dimensions if space in log.spaces else 3
    return TranslateSpace(space, tuple(by[:dimensions]))


def _epoch(log: SceneLog) -> KeyEpoch:
    return KeyEpoch(log.grants.key_epoch + 1, bytes([log.grants.key_epoch % 256]) * 24)


_SPACE = st.sampled_from(SPACES)
_MEMBER = st.integers(1, 5)
_NODE = st.integers(1, 6).map(node)
_SINGLE: st.SearchStrategy[Any] = st.one_of(
    _created(),
    st.builds(lambda *what: lambda log: _shadow(log, *what), _SPACE, _SPACE, st.sampled_from(_OFFSETS)),
    st.builds(lambda space, by: lambda log: _move(log, space, by), _SPACE, st.lists(_NUMBERS, min_size=4, max_size=4)),
    st.builds(ScaleSpace, _SPACE, _FACTORS),
    st.builds(lambda space, copies: SetCopies(space, copies, 1), _SPACE, st.integers(1, 4)),
    st.builds(SetMode, st.sampled_from((SceneMode.EDIT, SceneMode.RENDER))),
    st.just(BeginPurge()),
    st.builds(
        RenderSettings, samples=st.none() | st.integers(1, 9), sky=st.none() | st.just((0.5, 0.0, 1.0)), camera=st.none() | st.just("door")
    ),
    st.builds(grant, _MEMBER, st.sampled_from(Role)),
    st.builds(lambda entry: AddParticipant(entry.member, entry.key), _NODE),
    st.builds(lambda entry: RemoveParticipant(entry.member), _NODE),
    st.builds(lambda entry: AddObserver(entry.member, entry.key), _NODE),
    st.builds(lambda entry: RemoveObserver(entry.member), _NODE),
    st.builds(lambda number: lambda log: Batch((Revoke(secrets_of(number).signing.key_id), _epoch(log))), st.one_of(_MEMBER, st.just(200))),
    st.just(_epoch),
)
WISHES = st.one_of(_SINGLE, st.lists(_SINGLE, min_size=1, max_size=4))


def entry_of(log: SceneLog, wish: Any) -> LogEntry:
    """What a wish comes to in this log, whether it fits or not."""
    parts = wish if isinstance(wish, list) else [wish]
    entries = [part(log) if callable(part) else part for part in parts]
    flat = [single for entry in entries for single in (entry.entries if isinstance(entry, Batch) else (entry,))]
    return flat[0] if len(flat) == 1 else Batch(tuple(flat))


def records_by(wishes: list[Any], copies: int = 1) -> list[LogRecord]:
    """A log in which of these wishes those came true that fitted."""
    records = [first_record(GENESIS, ORIGIN, MAKER, copies=copies)]
    log = SceneLog.of(records)
    for index, wish in enumerate(wishes):
        record = log.next_record(entry_of(log, wish), index.to_bytes(16, "little"), ORIGIN)
        try:
            log = log.extended((record,))
        except Refused:
            continue
        records.append(record)
    return records


RECORDS = st.builds(records_by, st.lists(WISHES, min_size=1, max_size=25), st.integers(1, 3)).filter(lambda records: len(records) > 1)


def whole(records: list[LogRecord]) -> OpenedLog:
    """The log of these records, signed."""
    return OpenedLog(SceneLog.of(records), tuple(sign_record(record, HEADER_KEY) for record in records))


def sealed(log: OpenedLog, genesis: bytes = GENESIS) -> bytes:
    return seal_private(log.records, genesis=genesis, symmetric_key=KEY, key_epoch=0, nonce=bytes(12), snapshot=log.snapshot)


def opening(log: OpenedLog) -> dict[str, Any]:
    """What who opens the sealed log knows of it."""
    return {
        "genesis": GENESIS,
        "position": log.state.position,
        "symmetric_key": KEY,
        "header_key": HEADER_KEY.public,
        "header_keyed_at": log.state.grants.header_keyed_at,
    }
