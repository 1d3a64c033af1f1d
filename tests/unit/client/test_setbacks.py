"""If this fails, a node can lead a client back behind what that has read or written, and it does not notice; or it cries for nothing."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from trio.testing import MockClock

from scenefold.base.ids import SpaceId
from scenefold.base.location import Location
from scenefold.client import setbacks
from scenefold.client.sealing import Opened
from scenefold.client.setbacks import Setbacks
from scenefold.client.tombstones import tombstone
from scenefold.client.verifying import Key
from scenefold.crypto.record_header import Version
from unit.client.fake_nodes import FakeNodes
from unit.client.test_records import FILES, PLACES, _scene

HERE, THERE = PLACES[3], PLACES[4]
KEY: Key = (FILES, HERE)
GONE = tombstone(20, bytes)


def version(number: int) -> Version:
    return 1, number, 0, 0, b""


def opened(number: int, payload: bytes = b"x") -> Opened:
    return Opened(payload, number, b"", version=version(number))


@pytest.mark.expect_log("older than this client has met")
async def test_an_owner_that_gives_an_older_version_is_noticed_once(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    scene = _scene(nodes)
    space = scene.space(FILES)
    await space.put(HERE, b"old")
    before = dict(nodes.records)
    await space.put(HERE, b"new")
    nodes.records.update(before)
    assert await space.get(HERE) == b"old"
    assert scene.access.setbacks.count == 1
    await space.get(HERE)
    assert (scene.access.setbacks.count, scene.access.setbacks.of(KEY)) == (1, 1)


@pytest.mark.expect_log("older than this client has met")
async def test_an_owner_that_holds_back_what_was_read_is_noticed(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    await _scene(nodes).space(FILES).put(HERE, b"here")
    scene = _scene(nodes)
    assert await scene.space(FILES).get(HERE) == b"here"
    nodes.records.clear()
    assert await scene.space(FILES).get(HERE) is None
    assert scene.access.setbacks.count == 1


async def test_what_was_never_met_and_what_was_deleted_may_be_missing(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    scene = _scene(nodes)
    space = scene.space(FILES)
    await space.put(HERE, b"here")
    assert not scene.access.setbacks.ends_deleted((FILES, HERE))
    await space.delete(HERE)
    assert scene.access.setbacks.ends_deleted((FILES, HERE)) and not scene.access.setbacks.ends_deleted((FILES, THERE))
    nodes.records.clear()
    assert await space.get_many([HERE, THERE]) == [None, None]
    assert not scene.access.setbacks.count


async def test_a_stale_answer_that_was_wanted_is_no_setback(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    scene = _scene(nodes)
    await scene.space(FILES).put(HERE, b"here")
    nodes.records.clear()
    assert await scene.access.get([KEY], stale_ok=True) == [None]
    assert not scene.access.setbacks.count


def test_what_is_met_while_a_question_is_under_way_says_nothing_of_its_answer() -> None:
    met = Setbacks()
    asked_at = met.moment()
    met.wrote(KEY, version(2), is_deleted=False)
    assert met.read([KEY], [opened(1)], asked_at) == []
    assert met.read([KEY], [opened(1)], met.moment()) == [KEY]


def test_what_is_withheld_shown_and_withheld_again_is_noticed_each_time_and_is_no_deletion() -> None:
    met = Setbacks()
    met.wrote(KEY, version(1), is_deleted=False)
    for times in range(1, 4):
        assert met.read([KEY], [None], met.moment()) == [KEY]
        assert met.read([KEY], [None], met.moment()) == [], "once each time"
        assert met.of(KEY) == times and not met.ends_deleted(KEY)
        asked_at = met.moment()
        assert met.read([KEY], [opened(1)], met.moment()) == []
        assert met.read([KEY], [None], asked_at) == [], "it may have been answered before the other one"


def test_what_was_shown_is_not_gone_back_behind_until_an_owner_says_what_there_is() -> None:
    met = Setbacks()
    met.showed(KEY, opened(3))
    assert met.is_behind(KEY, opened(2), met.moment()) and met.is_behind(KEY, None, met.moment())
    met.showed(KEY, opened(2))
    met.showed(KEY, None)
    assert not met.is_behind(KEY, opened(3), met.moment()) and met.is_behind(KEY, opened(2), met.moment())
    assert met.read([KEY], [opened(2)], met.moment()) == [], "nobody has said that what was shown counts"
    assert not met.is_behind(KEY, opened(2), met.moment())
    met = Setbacks()
    met.showed(KEY, opened(4, GONE))
    assert not met.is_behind(KEY, None, met.moment()), "what was deleted may be purged"


def test_only_so_much_of_what_was_shown_is_remembered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(setbacks, "PLACES_MAX", 2)
    met = Setbacks()
    keys: list[Key] = [(FILES, Location.from_number(number)) for number in range(3)]
    for key in keys:
        met.showed(key, opened(2))
    assert [met.is_behind(key, opened(1), met.moment()) for key in keys] == [False, True, True]


def test_an_object_is_one_wherever_it_lies() -> None:
    met = Setbacks()
    met.wrote((SpaceId(9), HERE, b"object"), version(2), is_deleted=False)
    assert met.read([(SpaceId(9), THERE, b"object")], [None], met.moment())


@given(st.lists(st.tuples(st.integers(0, 3), st.none() | st.integers(1, 9), st.booleans())))
def test_one_reader_notices_exactly_what_is_behind_the_answer_before(answers: list[tuple[int, int | None, bool]]) -> None:
    met = Setbacks()
    last: dict[int, tuple[int, bool]] = {}
    missing = set[int]()
    for place, number, shown_deleted in answers:
        key: Key = FILES, PLACES[place]
        before = last.get(place)
        # A version is one record.
        is_deleted = before[1] if before is not None and number == before[0] else shown_deleted
        found = None if number is None else opened(number, GONE if is_deleted else b"x")
        is_behind = before is not None and (not before[1] and place not in missing if number is None else number < before[0])
        assert bool(met.read([key], [found], met.moment())) == is_behind
        if number is not None:
            last[place] = number, is_deleted
            missing.discard(place)
        elif before is not None and not before[1]:
            missing.add(place)
        assert met.ends_deleted(key) == (place in last and last[place][1])


def test_only_so_many_are_remembered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(setbacks, "PLACES_MAX", 2)
    met = Setbacks()
    keys: list[Key] = [(FILES, Location.from_number(number)) for number in range(3)]
    for key in keys:
        met.wrote(key, version(1), is_deleted=False)
    assert met.read(keys, [None] * 3, met.moment()) == keys[1:]
