"""If one fails, a scene goes on behind its end, or is ended where it must not be."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.base.errors import LocalFault, Refused
from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.crypto import SigningKey
from scenefold.scene.log import SceneLog, first_log
from scenefold.scene.log.shortening import cut_at
from scenefold.scene.log.states import packed_state, unpacked_state
from scenefold.wire import (
    Batch,
    BeginPurge,
    EndScene,
    LogEntry,
    MalformedPacket,
    Role,
    SceneMode,
    SetMode,
    TranslateSpace,
    encode_packet,
)
from scenefold.wire.lease_packets import LentLease
from scenefold.wire.log_entries import LOG_ENTRY
from scenefold.wire.pieces import unpack_piece
from unit.scene.log.council import Council, added
from unit.scene.log.members import grant
from unit.scene.log.test_book import GENESIS, ORIGIN, space, with_entries

LATER: tuple[LogEntry, ...] = (
    EndScene(),
    SetMode(SceneMode.EDIT),
    SetMode(SceneMode.RENDER),
    BeginPurge(),
    grant(1, Role.WRITER),
    added(4),
    space(),
    TranslateSpace(space().space, (0.0, 0.0, 0.0)),
)


def test_it_is_a_mode_of_its_own_and_raises_the_write_floor() -> None:
    log = with_entries(space(), EndScene())
    assert (log.position, log.mode, log.write_floor) == (3, SceneMode.ENDED, 3)
    assert log.purged == 0


@given(st.lists(st.sampled_from(LATER), min_size=1, max_size=3))
@settings(max_examples=30, deadline=None)
def test_nothing_is_well_formed_behind_it_in_its_record_or_the_log(later: list[LogEntry]) -> None:
    before = with_entries(space())
    log = before.apply(before.next_record(EndScene(), bytes(16), ORIGIN))
    for entry in later:
        with pytest.raises(Refused, match="was ended at position 3") as told:
            log.apply(log.next_record(entry, b"x" * 16, ORIGIN))
        assert told.value.reason is RejectReason.ILL_FORMED
    with pytest.raises(Refused, match="was ended at position 3"):
        before.apply(before.next_record(Batch((EndScene(), *later)), b"y" * 16, ORIGIN))  # type: ignore[arg-type]


def test_it_may_end_a_batch_and_a_whole_log() -> None:
    log = first_log(GENESIS, ORIGIN, grant(1, Role.OWNER), copies=1)
    ended = log.apply(log.next_record(Batch((space(), EndScene())), bytes(16), ORIGIN))
    assert ended.mode is SceneMode.ENDED
    round_about = log.next_record(Batch((SetMode(SceneMode.RENDER), SetMode(SceneMode.EDIT), EndScene())), bytes(16), ORIGIN)
    with pytest.raises(Refused, match="once at most"):
        log.apply(round_about)
    assert log.extended((round_about,)).mode is SceneMode.ENDED, "as it is read"


def test_it_does_not_end_while_it_is_rendered_nor_before_it_began() -> None:
    with pytest.raises(Refused, match="render mode") as told:
        with_entries(SetMode(SceneMode.RENDER), EndScene())
    assert "edit mode" in told.value.remedy
    with pytest.raises(Refused, match="begins before"):
        SceneLog().apply(SceneLog().next_record(EndScene(), bytes(16), NodeId(1)))


def test_nobody_sets_the_mode_to_it_and_no_snapshot_stands_for_it() -> None:
    ended = LOG_ENTRY.structs[4]
    assert "SceneMode 0..1" in str([kind.text for _, kind in ended.fields])
    with pytest.raises(MalformedPacket):
        unpack_piece(LOG_ENTRY, b"\x92\x04\x02")
    log = with_entries()
    with pytest.raises(Refused, match="no change of its mode"):
        log._entered(SetMode(SceneMode.ENDED), log.position + 1)
    assert unpack_piece(LOG_ENTRY, b"\x92\x04\x01") == SetMode(SceneMode.RENDER)
    assert unpack_piece(LOG_ENTRY, b"\x91\x10") == EndScene()
    with pytest.raises(LocalFault):
        packed_state(with_entries(EndScene()))
    # A participant that knows the end says so to whoever asks for the mode.
    assert encode_packet(LentLease(1, NodeId(1), 3, SceneMode.ENDED, is_active=True))


def test_a_log_that_was_shortened_ends_like_a_whole_one() -> None:
    council = Council()
    council.decide(grant(1, Role.WRITER))
    council.decide(EndScene())
    header, seed = council.header, council.keys.header_seed
    assert (header.mode, header.write_floor) == (SceneMode.ENDED, header.position) and seed is not None
    short = cut_at(council.log, len(council.log.records) - 1, header.genesis, SigningKey.from_seed(seed))
    assert short.snapshot is not None
    folded = unpacked_state(short.snapshot.state).extended(record.decoded() for record in short.records)
    assert folded == council.log.state and folded.mode is SceneMode.ENDED
    with pytest.raises(Refused, match="was ended"):
        council.offer(grant(2))
