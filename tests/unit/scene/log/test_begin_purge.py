"""If one fails, a purge begins unseen, or what was signed before it can still be written."""

from __future__ import annotations

import pytest

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.scene.log import SceneLog
from scenefold.wire import Batch, BeginPurge, LogEntry, SceneMode, SetMode


def with_entries(*entries: LogEntry) -> SceneLog:
    log = SceneLog()
    for entry in entries:
        log = log.apply(log.next_record(entry, log.position.to_bytes(16, "big"), NodeId(1)))
    return log


def test_it_raises_the_write_floor_and_the_newest_counts() -> None:
    assert SceneLog().purged == 0
    log = with_entries(SetMode(SceneMode.EDIT), BeginPurge(), SetMode(SceneMode.EDIT), BeginPurge(), SetMode(SceneMode.RENDER))
    assert (log.purged, log.write_floor) == (4, 5)
    assert (with_entries(Batch((BeginPurge(),))).purged, with_entries(BeginPurge()).write_floor) == (1, 1)


def test_nothing_is_purged_while_the_scene_is_rendered() -> None:
    with pytest.raises(Refused) as problem:
        with_entries(SetMode(SceneMode.RENDER), BeginPurge())
    assert problem.value.reason is RejectReason.MODE_FORBIDS
