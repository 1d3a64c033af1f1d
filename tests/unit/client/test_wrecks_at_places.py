"""If this fails, a damaged record cannot be written over by who was told to, or costs the user an error that speaks of something else."""

from __future__ import annotations

import pytest
from trio.testing import MockClock

from scenefold.base.errors import Refused
from scenefold.base.location import FIRST, LAST
from scenefold.base.reasons import RejectReason
from scenefold.client.space import ABSENT
from scenefold.crypto import RecordHeader
from scenefold.wire import PutMany
from unit.client.fake_nodes import FakeNodes
from unit.client.test_records import FILES, ITEMS, PLACES, _scene

DAY = 24 * 3600 * 10**6


async def _wrecked(nodes: FakeNodes, ahead_s: float) -> None:
    """A record at FIRST by a writer with a clock that is ahead of all others, whose header has rotted at its node."""
    writer = _scene(nodes)
    wall = writer.access.calls.world.clock.wall() + ahead_s
    writer.access.sequencer.saw(int(wall * 1e6), wall)
    await writer.space(FILES).put(FIRST, b"from a clock that is ahead")
    nodes.wrecks.add(FIRST)


async def test_what_a_clock_that_was_ahead_left_is_written_over_and_nothing_else_moves(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    await _wrecked(nodes, ahead_s=23 * 3600)
    scene, reader = _scene(nodes), _scene(nodes)
    began = autojump_clock.current_time()
    await scene.space(FILES).put_many([(FIRST, b"healed"), (LAST, b"beside it")])
    assert autojump_clock.current_time() == began, "no lease is waited for"
    assert await reader.space(FILES).get_many([FIRST, LAST]) == [b"healed", b"beside it"]
    await reader.space(FILES).put(LAST, b"later")
    numbers = [RecordHeader.decode(nodes.records[FILES, place].header).seq for place in (FIRST, LAST)]
    assert numbers[0] - numbers[1] > DAY, "its number is passed at its own place alone"
    await reader.space(FILES).put(FIRST, b"and over it")
    assert await scene.space(FILES).get(FIRST) == b"and over it"


async def test_a_version_that_no_clock_gives_is_told_in_the_end_and_the_others_are_there(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    await _wrecked(nodes, ahead_s=400 * 24 * 3600)
    space = _scene(nodes).space(FILES)
    began, asked = autojump_clock.current_time(), len(nodes.asked)
    with pytest.raises(Refused, match="the record that lies there is damaged") as refused:
        await space.put_many([(FIRST, b"mine"), *ITEMS[1:]])
    assert refused.value.reason is RejectReason.DAMAGED and FIRST.hex() in refused.value.where and refused.value.remedy
    assert autojump_clock.current_time() == began
    puts = [packet for _, packet in nodes.asked[asked:] if isinstance(packet, PutMany) and packet.items[0].location == FIRST]
    assert len(puts) == 2
    assert await space.get_many(PLACES[1:]) == [payload for _, payload in ITEMS[1:]]


async def test_who_expects_something_is_told_how_to_heal_it(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    await _wrecked(nodes, ahead_s=0)
    space = _scene(nodes).space(FILES)
    with pytest.raises(Refused, match=r"damaged.*by what it expects") as refused:
        await space.put(FIRST, b"mine", expect=ABSENT)
    assert refused.value.reason is RejectReason.DAMAGED and "without" in refused.value.remedy
    await space.delete(FIRST)
    await space.put(FIRST, b"mine", expect=ABSENT)
    assert await space.get(FIRST) == b"mine"
