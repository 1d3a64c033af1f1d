"""If one fails, who takes any one node's word is given a stray, what is older than was met, or what somebody forged."""

from __future__ import annotations

from dataclasses import replace

import pytest
import trio
from trio.testing import MockClock

from scenefold.base.errors import DamagedData, Refused, Unreachable
from scenefold.base.ids import node_id_of
from scenefold.base.location import Location
from scenefold.client import Space
from scenefold.wire import Configuration, Member, RecordBytes
from unit.client.test_copy_reads import LAYOUTS, HoldingNodes, kept_scene, owned_by
from unit.client.test_records import FILES, ITEMS, PLACES, _scene


def stranger_at(nodes: HoldingNodes) -> Space:
    """A client that has met nothing yet."""
    space = _scene(nodes).space(FILES)
    space._access.identity = replace(space._access.identity, layouts=LAYOUTS)
    return space


async def test_any_copy_is_what_anybody_has(autojump_clock: MockClock) -> None:
    nodes = HoldingNodes()
    scene = await kept_scene(nodes)
    missing = Location.from_number(PLACES[3].number + 1)
    nodes.without_lease |= set(nodes.addresses)
    nodes.away |= set(nodes.addresses[:2])
    with trio.fail_after(1):
        payloads = await scene.space(FILES).get_many([*PLACES, missing], any_copy=True)
    assert payloads == [*(payload for _, payload in ITEMS), None]


async def test_any_copy_is_never_older_than_what_was_met(autojump_clock: MockClock) -> None:
    nodes = HoldingNodes()
    scene = await kept_scene(nodes)
    owner, behind, other = nodes.addresses[1], nodes.addresses[0], nodes.addresses[2]
    (place, *_) = owned_by(nodes, owner)
    await scene.space(FILES).put(place, b"newer")
    nodes.away |= {owner, other}
    with pytest.raises((Refused, Unreachable)):
        await scene.space(FILES).get(place, any_copy=True)
    nodes.away.remove(other)
    nodes.kept[other] = {where: RecordBytes(item.signature, item.header, item.ciphertext) for (_, where), item in nodes.records.items()}
    assert await scene.space(FILES).get(place, any_copy=True) == b"newer"
    stranger = stranger_at(nodes)
    nodes.away.add(other)
    assert await stranger.get(place, any_copy=True) not in (None, b"newer"), f"who has met nothing takes what {behind} has"


async def test_any_copy_is_never_older_than_what_any_copy_has_shown(autojump_clock: MockClock) -> None:
    nodes = HoldingNodes()
    scene = await kept_scene(nodes)
    owner, behind, other = nodes.addresses[1], nodes.addresses[0], nodes.addresses[2]
    (place, *_) = owned_by(nodes, owner)
    await scene.space(FILES).put(place, b"newer")
    nodes.kept[other] = {where: RecordBytes(item.signature, item.header, item.ciphertext) for (_, where), item in nodes.records.items()}
    stranger = stranger_at(nodes)
    nodes.away |= {owner, behind}
    assert await stranger.get(place, any_copy=True) == b"newer"
    nodes.away = {owner, other}
    with pytest.raises((Refused, Unreachable)):
        await stranger.get(place, any_copy=True)
    nodes.away = {owner}
    assert await stranger.get(place, any_copy=True) == b"newer"
    assert not stranger._access.setbacks.count, "nobody was led back by who need not know"


async def test_any_copy_goes_on_to_the_next_where_one_is_forged_or_rotten(autojump_clock: MockClock) -> None:
    nodes = HoldingNodes(rotten={PLACES[3]})
    scene = await kept_scene(nodes)
    others = [address for address in nodes.addresses if nodes.table.owner_of(PLACES[3]).address != address]
    nodes.kept[others[0]][PLACES[3]] = replace(nodes.kept[others[0]][PLACES[3]], ciphertext=bytes(64))
    assert await scene.space(FILES).get(PLACES[3], any_copy=True) == ITEMS[3][1]
    nodes.away.add(others[1])
    with pytest.raises((DamagedData, Refused, Unreachable)):
        await scene.space(FILES).get(PLACES[3], any_copy=True)


async def test_any_copy_is_no_stray_as_long_as_a_holder_may_have_something_newer(autojump_clock: MockClock) -> None:
    nodes = HoldingNodes()
    scene = await kept_scene(nodes)
    place = PLACES[3]
    owner = nodes.table.owner_of(place)
    astray, other = (address for address in nodes.addresses if address != owner.address)
    nodes.claimed[astray] = Configuration(0, (Member(node_id_of(astray), bytes(16)),), 1)
    await scene.space(FILES).put(place, b"newer")
    item = nodes.records[FILES, place]
    nodes.kept[other][place] = RecordBytes(item.signature, item.header, item.ciphertext)
    nodes.away.add(owner.address)
    stranger = stranger_at(nodes)
    assert await stranger.get(place, any_copy=True) == b"newer"
    nodes.away.add(other)
    stranger = stranger_at(nodes)
    with pytest.raises((Refused, Unreachable)):
        await stranger.get(place, any_copy=True)
