"""If this fails, a scene's log that begins with a snapshot says something else than the records that were there."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.base.errors import DamagedData, LocalFault, Refused
from scenefold.base.ids import SpaceId
from scenefold.base.limits import LOG_BYTES_MAX
from scenefold.base.location import FIRST
from scenefold.scene.log import (
    Layouts,
    OpenedLog,
    SceneLog,
    SpaceFault,
    check_log,
    check_told,
    cut_at,
    open_private,
    packed_state,
    shortened,
    unpacked_state,
)
from scenefold.scene.log.affine import Affine
from scenefold.wire import CreateSpace, CurveKind, KeyEpoch, LogRecord, Role, ScaleSpace, SceneMode, SetMode, TranslateSpace
from unit.scene.log.members import grant
from unit.scene.log.random_logs import GENESIS, HEADER_KEY, ORIGIN, RECORDS, opening, records_by, sealed, whole
from unit.scene.log.test_grants import Story

HALL = SpaceId(11)
MADE = CreateSpace(HALL, 3, CurveKind.HILBERT, False, SpaceId(0), FIRST, 1, 1, False, "hall", (0.0,) * 3, (8.0,) * 3)


def exactly(transform: Affine) -> tuple[object, ...]:
    """All of it, the signs of zeros and what rounding hides."""
    return transform.factor.hex(), tuple(part.hex() for part in transform.offset), transform.exact


def answers(log: SceneLog) -> list[object]:
    """What can be asked of a log."""
    found: list[object] = [log, log.head, list(log.spaces), log.public_spaces(), Layouts.of(log.public_spaces()), dict(log.requests)]
    found += [log.grants, dict(log.grants.former_keys), log.roster, log.mode, log.write_floor, log.purged, list(log.free_ids())[:20]]
    for space in log.spaces.values():
        found += [space, space.document(), exactly(space.transform)]
        if not space.steps:
            continue
        for position in range(log.position + 2):
            found += [exactly(space.transform_since(position)), exactly(space.transform_until(position))]
        points = np.linspace(*map(np.asarray, space.world_box), 4)
        found.append(space.fast_forward(points, log.position // 2).tobytes())
        try:
            low, high = points[1].tolist(), points[2].tolist()
            found += [space.locations_of(points), space.box_arcs(low, high, 16)]
        except SpaceFault as fault:
            found.append(str(fault))
    return found


@given(RECORDS, st.data())
@settings(max_examples=40, deadline=None)
def test_a_snapshot_and_what_follows_say_what_all_records_say(records: list[LogRecord], data: st.DataObject) -> None:
    log = whole(records)
    count = data.draw(st.integers(1, len(records) - 1), "cut at")
    short = cut_at(log, count, GENESIS, HEADER_KEY)
    assert short.records == log.records[count:] and short.state is log.state
    opened = open_private(sealed(short), **opening(log))
    assert opened == short
    assert answers(opened.state) == answers(log.state)
    again = data.draw(st.integers(1, len(short.records)), "cut again at")
    if again < len(short.records):
        shorter = cut_at(opened, again, GENESIS, HEADER_KEY)
        assert shorter == cut_at(log, count + again, GENESIS, HEADER_KEY)
        assert answers(open_private(sealed(shorter), **opening(log)).state) == answers(log.state)


@given(RECORDS)
@settings(max_examples=40, deadline=None)
def test_a_state_has_one_form_and_goes_on_as_it_would(records: list[LogRecord]) -> None:
    half = SceneLog.of(records[: len(records) // 2 + 1])
    found = unpacked_state(packed_state(half))
    assert packed_state(found) == packed_state(half)
    rest = records[half.position :]
    assert answers(found.extended(rest)) == answers(SceneLog.of(records))


@given(RECORDS, st.data())
@settings(max_examples=25, deadline=None)
def test_who_has_read_a_part_takes_the_snapshot_of_the_same_log(records: list[LogRecord], data: st.DataObject) -> None:
    log = whole(records)
    short = cut_at(log, data.draw(st.integers(1, len(records) - 1), "cut at"), GENESIS, HEADER_KEY)
    private = sealed(short)
    for read in range(len(records) + 1):
        known = OpenedLog(SceneLog.of(records[:read]), log.records[:read])
        assert open_private(private, known=known, **opening(log)) == short
        if read > short.state.position - len(short.records):
            behind = replace(short, state=known.state, records=short.records[: read - len(records) or None])
            assert open_private(private, known=behind, **opening(log)) == short
    assert open_private(sealed(log), known=short, **opening(log)) == log, "a whole log shows all that it is"


def other(records: list[LogRecord], at: int, entry: Any) -> OpenedLog:
    """The same log but for what was decided at a position, and with the request of that."""
    log = SceneLog.of(records[: at - 1])
    made = [*records[: at - 1], log.next_record(entry, records[at - 1].request_id, ORIGIN)]
    for record in records[at:]:
        log = SceneLog.of(made)
        made.append(log.next_record(record.entry, record.request_id, ORIGIN))
    return whole(made)


STORY = [
    MADE,
    TranslateSpace(HALL, (1.0, 2.0, 3.0)),
    grant(1, Role.WRITER),
    KeyEpoch(1, b"k" * 24),
    SetMode(SceneMode.RENDER),
    SetMode(SceneMode.EDIT),
    ScaleSpace(HALL, 3.0),
    SetMode(SceneMode.EDIT),
]


@pytest.mark.parametrize(
    ("at", "entry", "what"),
    [
        (2, replace(MADE, high=(9.0,) * 3), "space 11"),
        (3, TranslateSpace(HALL, (1.0, 2.0, 3.5)), "space 11"),
        (3, SetMode(SceneMode.EDIT), "space 11"),
        (4, grant(2, Role.WRITER), "members or keys"),
        (4, grant(1, Role.OWNER), "members or keys"),
        (5, KeyEpoch(1, b"x" * 24), "members or keys"),
        (5, SetMode(SceneMode.EDIT), "members or keys"),
        (6, TranslateSpace(HALL, (0.0,) * 3), "space 11"),
    ],
    ids=str,
)
def test_who_has_read_something_else_takes_no_snapshot(at: int, entry: Any, what: str) -> None:
    records = records_by(STORY)
    short = cut_at(whole(records), 8, GENESIS, HEADER_KEY)
    read = other(records, at, entry)
    for known in range(at, len(records) + 1):
        before = OpenedLog(SceneLog.of(one.decoded() for one in read.records[:known]), read.records[:known])
        expected = what if known < 8 else "the state"
        with pytest.raises(DamagedData, match=f"otherwise of {expected} than what was read up to position {known}"):
            open_private(sealed(short), known=before, **opening(short))


def test_a_request_that_was_read_must_be_there() -> None:
    records = records_by(STORY)
    renamed = replace(records[-1], request_id=b"another request.")
    short = cut_at(whole(records), 8, GENESIS, HEADER_KEY)
    same_effect = records[:5]
    same_effect[4] = replace(same_effect[4], request_id=renamed.request_id)
    known = whole(same_effect)
    with pytest.raises(DamagedData, match="otherwise of what was asked for"):
        open_private(sealed(short), known=known, **opening(short))


@contextmanager
def requests_kept(count: int) -> Iterator[None]:
    """As if a log knew no more request ids than these."""
    with patch("scenefold.scene.log.book.LOG_REQUESTS_KEPT", count), patch("scenefold.scene.log.states.LOG_REQUESTS_KEPT", count):
        with patch("scenefold.scene.log.agreement.LOG_REQUESTS_KEPT", count):
            yield


@given(RECORDS, st.integers(1, 6), st.data())
@settings(max_examples=20, deadline=None)
def test_old_request_ids_go_alike_with_records_and_with_snapshots(records: list[LogRecord], kept: int, data: st.DataObject) -> None:
    with requests_kept(kept):
        log = whole(records)
        assert dict(log.state.requests) == {record.request_id: record.position for record in records[-kept:]}
        step_by_step = SceneLog()
        for record in records:
            step_by_step = step_by_step.extended((record,))
        assert step_by_step == log.state
        short = cut_at(log, data.draw(st.integers(1, len(records) - 1)), GENESIS, HEADER_KEY)
        for read in range(len(records) + 1):
            known = OpenedLog(SceneLog.of(records[:read]), log.records[:read])
            assert open_private(sealed(short), known=known, **opening(log)) == short
        for record in records:
            entry = SetMode(SceneMode.EDIT)
            repeated = log.state.next_record(entry, record.request_id, ORIGIN)
            assert log.state.tells_of(record.position) == (record in records[-kept:])
            if log.state.tells_of(record.position):
                with pytest.raises(Refused, match="in the log already"):
                    log.state.extended((repeated,))
            else:
                after = log.state.extended((repeated,))
                assert after.requests[record.request_id] == after.position and len(after.requests) == kept


@contextmanager
def short_tails(records: int, kept: int) -> Iterator[None]:
    with patch("scenefold.scene.log.shortening.LOG_TAIL_RECORDS_MAX", records):
        with patch("scenefold.scene.log.shortening.LOG_TAIL_RECORDS_KEPT", kept):
            yield


def test_authors_keep_a_log_short_through_changes_of_the_header_key() -> None:
    story = Story()
    every = list(story.log.records)
    cuts = []
    with short_tails(8, 3):
        story.do(grant(1, Role.OWNER))
        every.append(story.log.records[-1])
        for step in range(40):
            if step in (9, 12, 25):
                number = 1 if step == 9 else step
                if step > 9:
                    story.do(grant(number, Role.OWNER))
                    every.append(story.log.records[-1])
                story.revoke(number)
            else:
                story.do(SetMode(SceneMode(step % 2)))
            every.append(story.log.records[-1])
            assert len(story.log.records) <= 8
            cuts.append(story.state.position - len(story.log.records))
            assert story.state == SceneLog.of(one.decoded() for one in every)
            check_told(story.header, story.state, is_shortened=story.log.snapshot is not None)
            story.read(story.keys)
    assert len(set(cuts)) > 5 and sorted(cuts) == cuts
    assert story.log.records == tuple(every[cuts[-1] :])


def test_the_word_of_a_revoked_owner_about_the_past_ends_with_its_key() -> None:
    story = Story()
    with short_tails(4, 2):
        for step in range(6):
            story.do(SetMode(SceneMode(step % 2)))
        story.do(grant(1, Role.OWNER))
        before = story.log.snapshot
        story.revoke(1)
    assert before is not None and story.log.snapshot is not None
    assert story.log.snapshot.state == before.state and story.log.snapshot.signature != before.signature
    told = {**opening(story.log), "genesis": story.header.genesis, "header_key": story.keys.header_key}
    assert open_private(sealed(story.log, story.header.genesis), **told) == story.log
    with pytest.raises(DamagedData, match="the signature is not that of key"):
        open_private(sealed(replace(story.log, snapshot=before), story.header.genesis), **told)


def test_short_logs_are_left_as_they_are() -> None:
    log = whole(records_by([SetMode(SceneMode.EDIT)] * 20))
    assert shortened(log, GENESIS, HEADER_KEY) is log
    with short_tails(21, 5):
        assert shortened(log, GENESIS, HEADER_KEY) is log
    with short_tails(20, 5):
        short = shortened(log, GENESIS, HEADER_KEY)
        assert short.records == log.records[-5:]
        assert shortened(short, GENESIS, HEADER_KEY) is short
    with (
        patch("scenefold.scene.log.shortening.LOG_TAIL_BYTES_MAX", 2_000),
        patch("scenefold.scene.log.shortening.LOG_TAIL_BYTES_KEPT", 500),
    ):
        few = shortened(log, GENESIS, HEADER_KEY).records
        assert 1 < len(few) < 5 and sum(len(one.record) + len(one.signature) for one in few) <= 500
    with patch("scenefold.scene.log.shortening.LOG_TAIL_BYTES_MAX", 2_000), patch("scenefold.scene.log.shortening.LOG_TAIL_BYTES_KEPT", 1):
        assert shortened(log, GENESIS, HEADER_KEY).records == log.records[-1:], "the author's own stays in any case"


def test_a_state_that_is_too_long_for_a_log_is_not_made() -> None:
    log = SceneLog.of(records_by(STORY))
    hall = log.space(HALL)
    with pytest.raises(LocalFault, match=f"at most {LOG_BYTES_MAX}"):
        packed_state(replace(log, spaces={HALL: replace(hall, steps=hall.steps[:1] * (LOG_BYTES_MAX // 40))}))


def test_an_author_is_told_that_the_log_is_too_long() -> None:
    story = Story()

    def go_on() -> None:
        for step in range(200):
            story.do(SetMode(SceneMode(step % 2)))

    told = r"log has become too long: .* at most 6000 are allowed \(scene kitchen, log position \d+\): put its content into a new scene"
    with short_tails(4, 2), patch("scenefold.wire.log_snapshots.LOG_BYTES_MAX", 6_000), pytest.raises(LocalFault, match=told):
        go_on()
    assert 20 < story.state.position < 200
    story.read(story.keys)


def test_a_shortened_log_is_the_one_that_its_header_names() -> None:
    story = Story()
    with short_tails(4, 2):
        for step in range(6):
            story.do(SetMode(SceneMode(step % 2)))
    check_log(story.header, story.private)
    for change in (
        {"mode": SceneMode.EDIT if story.header.mode else SceneMode.RENDER},
        {"spaces": story.header.spaces[1:]},
        {"writers": ()},
        {"write_floor": 1},
    ):
        with pytest.raises(DamagedData, match="mode, spaces or writers"):
            check_told(replace(story.header, **change), story.state, is_shortened=True)  # type: ignore[arg-type]
