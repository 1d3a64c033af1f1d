"""If this fails, a client gives up before a lease comes back, waits for ever, believes what may be outdated, or does twice what was asked once."""

from __future__ import annotations

import re
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest
import trio
from trio.testing import MockClock

from scenectl.errors import ending_of
from scenefold.base.errors import Refused, Unreachable
from scenefold.base.ids import NodeId
from scenefold.base.limits import CLIENT_BUSY_TRIES_MAX, CLIENT_TRIES_MAX
from scenefold.base.location import FIRST, Location
from scenefold.base.reasons import RejectReason
from scenefold.client.fresh import FreshItem, put_fresh
from scenefold.client.patience import Patience, as_told
from scenefold.client.space import ABSENT
from scenefold.crypto import wanted_place
from scenefold.peer.scene_log.proposals import rejection
from scenefold.wire import Packet, ProposeSceneLog, PutOutcome
from unit.client.fake_nodes import FakeNodes
from unit.client.test_records import FILES, ITEMS, PLACES, _scene
from unit.client.test_scenes import _scenes

LEASE_GAP_S = 12.0


def test_a_silent_node_wears_patience_out_sooner() -> None:
    silent, not_now, lasting = Patience(), Patience(), Patience()
    assert [silent.bears(Unreachable("")) for _ in range(CLIENT_TRIES_MAX)] == [True] * (CLIENT_TRIES_MAX - 1) + [False]
    total_s = 0.0
    for _ in range(CLIENT_BUSY_TRIES_MAX - 1):
        assert not_now.bears(Refused(RejectReason.NOT_READY, ""))
        total_s += not_now.pause_s(0.0)
    assert not not_now.bears(None)
    assert total_s > LEASE_GAP_S
    assert not lasting.bears(Refused(RejectReason.STALE_VERSION, ""))


async def test_a_lease_gap_is_waited_for(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    space = _scene(nodes).space(FILES)
    nodes.without_lease = set(nodes.addresses)

    async def renew() -> None:
        await trio.sleep(LEASE_GAP_S)
        nodes.without_lease = set()

    async with trio.open_nursery() as nursery:
        nursery.start_soon(renew)
        await space.put_many(ITEMS)
    nodes.without_lease = set(nodes.addresses)
    async with trio.open_nursery() as nursery:
        nursery.start_soon(renew)
        assert await space.get_many(PLACES) == [payload for _, payload in ITEMS]
    nodes.without_lease = set(nodes.addresses)
    async with trio.open_nursery() as nursery:
        nursery.start_soon(renew)
        assert [location async for location in space.query()] == PLACES


@pytest.mark.parametrize("call", ["read", "write", "list", "create", "open", "table"])
async def test_when_all_nodes_are_busy_all_the_time_that_is_said_and_what_to_do(
    call: str, autojump_clock: MockClock, tmp_path: Path
) -> None:
    nodes = FakeNodes()
    space, scenes = _scene(nodes).space(FILES), _scenes(nodes, tmp_path)
    await scenes.create("kitchen")
    nodes.busy.update(dict.fromkeys(nodes.addresses, 10**6))

    async def listed() -> None:
        async for _ in space.query():
            pass

    calls: dict[str, Callable[[], Awaitable[object]]] = {
        "read": lambda: space.get(PLACES[0]),
        "write": lambda: space.put_many(ITEMS),
        "list": listed,
        "create": lambda: scenes.create("hall"),
        "open": lambda: scenes.open("kitchen"),
        "table": nodes.calls().refresh,
    }
    with trio.fail_after(60), pytest.raises(Refused) as refused:
        await calls[call]()
    ending = ending_of(refused.value)
    assert (refused.value.reason, ending.kind, ending.exit_code) == (RejectReason.BUSY, "refused", 3)
    assert re.fullmatch(
        r"not now, however often it was tried: later \(127\.0\.0\.[234]\): repeat it in a while; .*status.*`scenectl cluster top`.*",
        ending.line,
    )


def test_what_is_no_load_is_not_blamed_on_it() -> None:
    told = as_told(Refused(RejectReason.BUSY, "id in use: 127.0.0.4 may hold a lease for 9 s more", where="127.0.0.2"))
    assert "id in use" in told.what and "busy" not in told.what and "less to do" not in told.remedy and told.remedy
    with_remedy = Refused(RejectReason.BUSY, "overtaken", remedy="try again")
    assert as_told(with_remedy) is with_remedy


async def test_a_place_that_changes_hands_all_the_time_is_busy_as_well(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    nodes._put = lambda _address, item: PutOutcome(RejectReason.BUSY, item.location, NodeId(0))  # type: ignore[method-assign]
    with trio.fail_after(60), pytest.raises(Refused, match=r"127\.0\.0\.2 is busy: the place is changing hands") as refused:
        await _scene(nodes).space(FILES).put(FIRST, b"x")
    assert ending_of(refused.value).exit_code == 3 and refused.value.remedy


async def test_who_changes_a_scene_too_often_is_told_so_if_waiting_does_not_help(autojump_clock: MockClock, tmp_path: Path) -> None:
    nodes = FakeNodes()
    kitchen = await _scenes(nodes, tmp_path).create("kitchen")
    refusals = [RejectReason.BUSY] * 3
    propose = nodes._propose

    def too_often(packet: ProposeSceneLog) -> Packet:
        return rejection(refusals.pop(), NodeId(0)) if refusals else propose(packet)

    nodes._propose = too_often  # type: ignore[method-assign]
    await kitchen.create_space("notes", dimensions=3)
    assert not refusals, "it was tried again until it went in"
    refusals += [RejectReason.BUSY] * 100
    with trio.fail_after(60), pytest.raises(Refused, match=r"busy: the scene was changed too often lately .*: try again") as refused:
        await kitchen.create_space("more", dimensions=3)
    assert ending_of(refused.value).exit_code == 3


async def test_a_stale_answer_counts_only_where_it_is_welcome(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    space = _scene(nodes).space(FILES)
    await space.put_many(ITEMS)
    nodes.without_lease = set(nodes.addresses)
    assert await space.get(PLACES[3], stale_ok=True) == ITEMS[3][1]
    with trio.fail_after(60), pytest.raises(Refused, match="may be stale") as refused:
        await space.get(PLACES[3])
    assert refused.value.reason is RejectReason.NOT_READY
    with trio.fail_after(60), pytest.raises(Refused, match="may be stale"):
        [location async for location in space.query()]
    with trio.fail_after(60), pytest.raises(Refused, match=r"127.0.0.2 has no lease.*voter"):
        await space.put(FIRST, b"x")


async def test_what_became_of_a_write_is_not_guessed(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    mine, other = _scene(nodes).space(FILES), _scene(nodes).space(FILES)
    await mine.put(FIRST, b"before")
    stored = dict(nodes.records)
    await other.put(FIRST, b"another one")
    newer = dict(nodes.records)
    nodes.records = stored
    nodes.lost_replies, nodes.ill_timed = 1, lambda: nodes.records.update(newer)
    mine._access.sequencer._last = 1_600_000_000_000_000
    with pytest.raises(Unreachable, match=r"answer to a write was lost.*stale version"):
        await mine.put(FIRST, b"perhaps", expect=b"\1" * 32)
    assert await mine.get(FIRST) == b"another one"


async def test_a_deleted_place_is_empty_and_free_again(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    scene = _scene(nodes)
    space = scene.space(FILES)
    with pytest.raises(Refused, match="another version"):
        await space.delete(FIRST, expect=b"\1" * 32)
    first = await space.put(FIRST, b"one", expect=ABSENT)
    deleted = await space.delete(FIRST, expect=first)
    assert deleted != first
    assert await space.get(FIRST) is None
    assert [location async for location in space.query()] == []
    assert [location async for location in space.query(deleted=True)] == [FIRST], "what says so lies there still"
    assert await space.put(FIRST, b"two", expect=ABSENT)
    assert await space.get(FIRST) == b"two"
    with pytest.raises(Refused, match="there is a record already"):
        await space.put(FIRST, b"three", expect=ABSENT)


async def test_an_import_takes_the_places_of_deleted_records_unless_what_it_brings_is_there(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    scene = _scene(nodes)
    second = FIRST.next()
    atoms = [FreshItem(FILES, FIRST, payload) for payload in (b"atom", b"atom", b"other")]
    assert second is not None
    before = await put_fresh(scene.access, atoms)
    assert [stored.location for stored in before] == [FIRST, second, second.next()]
    await scene.space(FILES).delete(FIRST)
    again = await put_fresh(scene.access, [atoms[2]])
    assert again == [before[2]._replace(reused=True)], "it lies behind the deleted one"
    again = await put_fresh(scene.access, atoms)
    assert sorted(stored.location for stored in again) == sorted(stored.location for stored in before)
    assert await scene.space(FILES).get_many([stored.location for stored in again]) == [b"atom", b"atom", b"other"]


async def test_a_list_that_leaves_out_the_deleted_names_what_cannot_be_read(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    space = _scene(nodes).space(FILES)
    await space.put_many(ITEMS)
    await space.delete(PLACES[0])
    nodes.records[FILES, PLACES[1]] = nodes.records[FILES, PLACES[2]]
    assert [location async for location in space.query()] == PLACES[1:]


async def test_node_managed_records_from_birth_to_death(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    scene = _scene(nodes)
    records = scene.space(9).managed
    stored = [await records.put(b"image %d" % number) for number in range(12)]
    places = [one.place for one in stored]
    assert {nodes.table.owner_of(place.location) for place in places} == {nodes.table.owner_of(wanted_place(places[0].object))}
    assert sorted(await _all(records)) == sorted(places)
    assert await records.get(places) == [b"image %d" % number for number in range(12)]
    again = await records.replace(places[0], b"newer", expect=stored[0].digest)
    assert again.place == places[0]
    with pytest.raises(Refused, match="another version"):
        await records.replace(places[0], b"late", expect=stored[0].digest)
    await records.delete(places[1])
    assert await records.get(places[:3]) == [b"newer", None, b"image 2"]
    assert places[1] not in await _all(records)
    assert places[1] in [place async for place in records.query(deleted=True)]
    assert await scene.space(9).put_managed(b"one more") in await _all(records)


async def test_a_node_cannot_give_one_object_for_another(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    records = _scene(nodes).space(9).managed
    one, other = (await records.put(b"one")).place, (await records.put(b"other")).place
    nodes.records[9, one.location] = nodes.records[9, other.location]
    with pytest.raises(Exception, match="belongs elsewhere"):
        await records.get([one])


async def _all(records: object) -> list[object]:
    return [place async for place in records.query()]  # type: ignore[attr-defined]


async def test_half_of_a_range_is_asked_for_where_the_whole_is_too_large(autojump_clock: MockClock) -> None:
    nodes = FakeNodes(range_max=2)
    space = _scene(nodes).space(FILES)
    await space.put_many(ITEMS)
    assert [location async for location in space.query(Location.from_number(0))] == PLACES
