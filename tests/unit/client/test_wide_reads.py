"""If one fails, much that lies with one owner is read from it alone, or comes older, or wrong, from those who hold copies."""

from __future__ import annotations

from dataclasses import replace

import pytest
import trio
from trio.testing import MockClock

from scenefold.base.errors import Refused, Unreachable
from scenefold.base.ids import address_of
from scenefold.base.limits import CLIENT_HEDGE_S, CLIENT_PART_RECORDS, CLIENT_STATUS_S
from scenefold.base.location import LINE_LENGTH, Location
from scenefold.client.scene import Scene
from scenefold.wire import GetCopies, GetMany, LookAtCopies, Packet, RecordBytes
from unit.client.test_copy_reads import LAYOUTS, HoldingNodes, asked
from unit.client.test_records import FILES, _scene

OWNER = "127.0.0.3"
COUNT = 60
PLACES = [Location.from_number(LINE_LENGTH // 3 + (index + 1) * (LINE_LENGTH // 300)) for index in range(COUNT)]
ITEMS = [(place, b"payload %d" % index + bytes(40_000)) for index, place in enumerate(PLACES)]
PAYLOADS = [payload for _, payload in ITEMS]
HOLDERS = ("127.0.0.2", "127.0.0.4")


async def kept_scene(nodes: HoldingNodes) -> Scene:
    """One node owns everything, and all have it."""
    scene = _scene(nodes)
    access = scene.space(FILES)._access
    access.identity = replace(access.identity, layouts=LAYOUTS)
    await scene.space(FILES).put_many(ITEMS)
    assert {nodes.table.owner_of(place).address for place in PLACES} == {OWNER}
    nodes.keep()
    nodes.asked.clear()
    return scene


def bytes_asked_of(nodes: HoldingNodes, address: str) -> int:
    """For how many records a node was asked, not only for their versions."""

    def count(packet: Packet) -> int:
        is_read = isinstance(packet, GetMany) or (isinstance(packet, GetCopies) and not packet.digests_only)
        return len(packet.keys) if is_read else 0  # type: ignore[attr-defined]

    return sum(count(packet) for where, packet in nodes.asked if where == address)


async def test_all_who_have_it_are_read_and_nothing_twice(autojump_clock: MockClock) -> None:
    nodes = HoldingNodes(slow=dict.fromkeys((OWNER, *HOLDERS), 0.01))
    scene = await kept_scene(nodes)
    missing = Location.from_number(PLACES[7].number + 1)
    assert await scene.space(FILES).get_many([*PLACES, missing]) == [*PAYLOADS, None]
    counts = [bytes_asked_of(nodes, address) for address in (OWNER, *HOLDERS)]
    assert min(counts) >= COUNT // 5 and sum(counts) <= COUNT + 1 + CLIENT_PART_RECORDS


async def test_few_records_and_such_as_are_spread_over_all_come_from_owners_alone(autojump_clock: MockClock) -> None:
    nodes = HoldingNodes()
    scene = await kept_scene(nodes)
    await scene.space(FILES).get_many(PLACES[:15])
    assert not asked(nodes, GetCopies)


async def test_a_slow_one_has_the_smaller_part_and_holds_up_nobody(autojump_clock: MockClock) -> None:
    nodes = HoldingNodes(slow={OWNER: 0.01, HOLDERS[0]: 0.01, HOLDERS[1]: 60.0})
    scene = await kept_scene(nodes)
    began = trio.current_time()
    assert await scene.space(FILES).get_many(PLACES) == PAYLOADS
    assert trio.current_time() - began < 2 * CLIENT_HEDGE_S
    nodes.slow = {OWNER: 0.01, HOLDERS[0]: 0.01, HOLDERS[1]: 0.1}
    nodes.asked.clear()
    assert await scene.space(FILES).get_many(PLACES) == PAYLOADS
    assert bytes_asked_of(nodes, HOLDERS[1]) < bytes_asked_of(nodes, HOLDERS[0])


@pytest.mark.parametrize("how", ["away", "hung", "without_lease"])
async def test_an_owner_that_says_nothing_is_not_needed(how: str, autojump_clock: MockClock) -> None:
    nodes = HoldingNodes(reply_records_max=7)
    scene = await kept_scene(nodes)
    getattr(nodes, how).add(OWNER)
    with trio.fail_after(3 * CLIENT_HEDGE_S):
        assert await scene.space(FILES).get_many(PLACES) == PAYLOADS


async def test_what_is_older_or_missing_or_forged_at_a_holder_is_asked_of_the_next(autojump_clock: MockClock) -> None:
    nodes = HoldingNodes(slow={OWNER: 0.05})
    scene = await kept_scene(nodes)
    older = dict(nodes.kept[HOLDERS[0]])
    newer = [(place, b"newer %d" % index + bytes(40_000)) for index, place in enumerate(PLACES)]
    await scene.space(FILES).put_many(newer)
    nodes.keep()
    nodes.kept[HOLDERS[0]] = older
    for index, (place, record) in enumerate(nodes.kept[HOLDERS[1]].items()):
        if index % 3 == 0:
            nodes.kept[HOLDERS[1]][place] = RecordBytes(record.signature, record.header, bytes(len(record.ciphertext)))
        elif index % 3 == 1:
            nodes.kept[HOLDERS[1]][place] = replace(record, signature=bytes(64))
    for place in PLACES[::5]:
        nodes.kept[HOLDERS[1]].pop(place)
    assert await scene.space(FILES).get_many(PLACES) == [payload for _, payload in newer]
    told = [(address, packet) for address, packet in nodes.asked if isinstance(packet, LookAtCopies)]
    assert {address for address, _ in told} == {OWNER}
    assert {address_of(packet.holder) for _, packet in told} == set(HOLDERS)
    lacking = {place for place in PLACES if place not in nodes.kept[HOLDERS[1]]}
    of_second = [key.location for _, packet in told if address_of(packet.holder) == HOLDERS[1] for key in packet.keys]
    assert of_second and set(of_second) <= lacking, "what is forged a comparison would not find"


async def test_what_has_rotted_at_its_owner_comes_from_holders(autojump_clock: MockClock) -> None:
    nodes = HoldingNodes(rotten=set(PLACES[::3]))
    scene = await kept_scene(nodes)
    assert await scene.space(FILES).get_many(PLACES) == PAYLOADS


async def test_without_anybody_the_owner_is_what_is_missing(autojump_clock: MockClock) -> None:
    nodes = HoldingNodes()
    scene = await kept_scene(nodes)
    nodes.away |= {OWNER, HOLDERS[0]}
    with trio.fail_after(20 * CLIENT_STATUS_S), pytest.raises((Unreachable, Refused)) as raised:
        await scene.space(FILES).get_many(PLACES)
    assert OWNER in str(raised.value) or address_of(nodes.table.owners[1].node_id) in str(raised.value)
