"""If this fails, a scene's log that begins with a snapshot is read as something else than was signed."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.base.errors import LocalFault
from scenefold.base.limits import LOG_BYTES_MAX, LOG_REQUESTS_KEPT
from scenefold.wire import MalformedPacket, ShortenedLog, SignedRecord, SignedSnapshot, SnapshotState
from scenefold.wire.log_snapshots import SHORTENED_LOG, SIGNED_SNAPSHOT, SNAPSHOT_STATE
from unit.wire.strategies import values
from unit.wire.vectors import example

PIECES = {SnapshotState: SNAPSHOT_STATE, ShortenedLog: SHORTENED_LOG}


@pytest.mark.parametrize("piece", PIECES, ids=lambda piece: piece.__name__)
def test_round_trip(piece: Any) -> None:
    @settings(max_examples=40, deadline=None)
    @given(values(PIECES[piece]), st.data())
    def check(value: Any, data: st.DataObject) -> None:
        encoded = value.encode()
        assert piece.decode(encoded) == value
        assert piece.decode(encoded).encode() == encoded
        cut = data.draw(st.integers(0, len(encoded) - 1))
        for wrong in (encoded[:cut], encoded + b"\0"):
            with pytest.raises(MalformedPacket):
                piece.decode(wrong)

    check()


@given(values(SIGNED_SNAPSHOT), values(SIGNED_SNAPSHOT), st.binary(min_size=32, max_size=32), st.binary(min_size=32, max_size=32))
def test_what_is_signed_is_one_state_of_one_scene(one: SignedSnapshot, other: SignedSnapshot, scene: bytes, another: bytes) -> None:
    assert (one.signable(scene) == other.signable(another)) == ((one.state, scene) == (other.state, another))


def test_bounds() -> None:
    state = example(SNAPSHOT_STATE, 1)
    replace(state, requests=bytes(16 * LOG_REQUESTS_KEPT)).encode()
    too_much: list[dict[str, Any]] = [
        {"requests": bytes(16 * LOG_REQUESTS_KEPT + 16)},
        {"former_keys": bytes(LOG_BYTES_MAX)},
        {"position": 0},
        {"head": bytes(31)},
        {"members": state.members * 65},
        {"spaces": state.spaces * 129},
    ]
    for changes in too_much:
        with pytest.raises(LocalFault):
            replace(state, **changes).encode()
    snapshot = SignedSnapshot(bytes(LOG_BYTES_MAX - 1_000), bytes(64))
    ShortenedLog(snapshot, (SignedRecord(b"r", bytes(64)),)).encode()
    with pytest.raises(LocalFault, match=f"at most {LOG_BYTES_MAX}"):
        ShortenedLog(snapshot, (SignedRecord(bytes(1_000), bytes(64)),)).encode()
    with pytest.raises(MalformedPacket):
        ShortenedLog.decode(bytes(LOG_BYTES_MAX + 1))
