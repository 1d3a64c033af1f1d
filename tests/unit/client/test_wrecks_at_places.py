"""If this fails, an error over a damaged record speaks of something else, or who says that one is damaged is given records to lie with."""

from __future__ import annotations

import pytest
from trio.testing import MockClock

from scenefold.base.errors import Refused
from scenefold.base.location import FIRST, Location
from scenefold.base.reasons import RejectReason
from scenefold.client.space import ABSENT
from scenefold.crypto import RecordHeader
from scenefold.wire import PutItem, PutMany
from unit.client.fake_nodes import FakeNodes
from unit.client.test_records import FILES, ITEMS, PLACES, _scene


async def _wrecked(nodes: FakeNodes, ahead_s: float) -> None:
    """A record at FIRST by a writer with a clock that is ahead of all others, whose header has rotted at its node."""
    writer = _scene(nodes)
    wall = writer.access.calls.world.clock.wall() + ahead_s
    writer.access.sequencer.saw(int(wall * 1e6), wall)
    await writer.space(FILES).put(FIRST, b"from a clock that is ahead")
    nodes.wrecks.add(FIRST)


@pytest.mark.parametrize("ahead_s", [60.0, 23 * 3600.0, 400 * 24 * 3600.0])
async def test_what_a_clock_that_was_ahead_left_is_told_at_once_and_the_others_are_there(autojump_clock: MockClock, ahead_s: float) -> None:
    nodes = FakeNodes()
    await _wrecked(nodes, ahead_s)
    space = _scene(nodes).space(FILES)
    began, asked = autojump_clock.current_time(), len(nodes.asked)
    with pytest.raises(Refused, match="says that the record there is damaged") as refused:
        await space.put_many([(FIRST, b"mine"), *ITEMS[1:]])
    assert refused.value.reason is RejectReason.DAMAGED and FIRST.hex() in refused.value.where
    assert nodes.table.owner_of(FIRST).address in refused.value.what
    for way_out in ("send it again", "change the scene's members or spaces", "drain"):
        assert way_out in refused.value.remedy
    assert autojump_clock.current_time() == began, "no lease is waited for"
    assert len(_puts_at(nodes, FIRST, asked)) == 1
    assert await space.get_many(PLACES[1:]) == [payload for _, payload in ITEMS[1:]]


@pytest.mark.parametrize("deletes", [False, True])
async def test_an_owner_that_lies_of_damage_is_given_nothing_above_what_clocks_give(autojump_clock: MockClock, deletes: bool) -> None:
    """It keeps what it is given, and could put that over whatever is written there later."""
    nodes = FakeNodes()
    scene = _scene(nodes)
    space = scene.space(FILES)
    await space.put(FIRST, b"acknowledged")
    nodes.liars_of_damage.add(nodes.table.owner_of(FIRST).address)
    asked = len(nodes.asked)
    with pytest.raises(Refused, match="damaged"):
        await (space.delete(FIRST) if deletes else space.put(FIRST, b"mine"))
    (given,) = _puts_at(nodes, FIRST, asked)
    assert RecordHeader.decode(given.header).seq <= scene.access.calls.world.clock.wall() * 1e6 + 60e6
    nodes.liars_of_damage.clear()
    await space.put(FIRST, b"later")
    assert RecordHeader.decode(nodes.records[FILES, FIRST].header).seq > RecordHeader.decode(given.header).seq


def _puts_at(nodes: FakeNodes, place: Location, since: int) -> list[PutItem]:
    packets = [packet for _, packet in nodes.asked[since:] if isinstance(packet, PutMany)]
    return [item for packet in packets for item in packet.items if item.location == place]


async def test_who_expects_something_is_told_how_to_heal_it(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    await _wrecked(nodes, ahead_s=-1.0)
    space = _scene(nodes).space(FILES)
    with pytest.raises(Refused, match=r"damaged.*by what it expects") as refused:
        await space.put(FIRST, b"mine", expect=ABSENT)
    assert refused.value.reason is RejectReason.DAMAGED and "without" in refused.value.remedy
    await space.delete(FIRST)
    await space.put(FIRST, b"mine", expect=ABSENT)
    assert await space.get(FIRST) == b"mine"
