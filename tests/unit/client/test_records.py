"""If this fails, the client loses records when nodes are away, arcs move or replies get lost, or believes forged ones."""

from __future__ import annotations

from dataclasses import replace

import pytest
import trio
from trio.testing import MockClock

from scenefold.base.errors import DamagedData, LocalFault, Refused, Unreachable
from scenefold.base.ids import KeyId, SceneId, SpaceId
from scenefold.base.location import FIRST, LAST, LINE_LENGTH, Location
from scenefold.base.reasons import RejectReason
from scenefold.client.access import SceneAccess
from scenefold.client.births import born, first_header, kept_keys, maker_of
from scenefold.client.fresh import FreshItem, put_fresh
from scenefold.client.reading import open_scene_with_keys
from scenefold.client.scene import Scene
from scenefold.client.sealing import SceneIdentity
from scenefold.client.space import ABSENT
from scenefold.client.verifying import WriterKey
from scenefold.client.versions import SEQ_MAX
from scenefold.crypto import EXPECTS_ANYTHING, EXPECTS_NOTHING, RecordHeader, SigningKey
from scenefold.scene.log import EpochKeys, decided
from scenefold.simulation.clients import secrets_of
from scenefold.wire import GetMany, PutMany
from unit.client.fake_nodes import KEEPER_KEY, ORIGIN, FakeNodes

WRITER = SigningKey(bytes(31) + b"\1")
FILES = SpaceId(10)
PLACES = [Location.from_number(LINE_LENGTH * index // 30) for index in range(30)]
ITEMS = [(place, b"payload %d" % index) for index, place in enumerate(PLACES)]


def _scene(nodes: FakeNodes, writer: SigningKey = WRITER) -> Scene:
    identity = SceneIdentity(SceneId(9), bytes(32), 1, {writer.key_id: WriterKey.always(writer.public)}, EpochKeys.only(bytes(24)))
    return Scene(SceneAccess(nodes.calls(), "kitchen", identity, writer, session=1))


async def test_what_was_put_is_got_in_order_from_all_owners(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    space = _scene(nodes).space(FILES)
    await space.put_many(ITEMS)
    assert await space.get_many([*PLACES, Location.from_number(5)]) == [payload for _, payload in ITEMS] + [None]
    assert {address for address, packet in nodes.asked if isinstance(packet, PutMany)} == set(nodes.addresses)
    assert not any(payload in item.ciphertext for _, payload in ITEMS for item in nodes.records.values())


async def test_a_rotten_record_is_said_to_be_and_the_others_are_got(autojump_clock: MockClock) -> None:
    nodes = FakeNodes(rotten={PLACES[3]})
    space = _scene(nodes).space(FILES)
    await space.put_many(ITEMS)
    with pytest.raises(Refused, match=PLACES[3].hex()) as refusal:
        await space.get_many(PLACES)
    assert refusal.value.reason is RejectReason.NOT_READY
    assert await space.get_many(PLACES[:3] + PLACES[4:]) == [payload for _, payload in ITEMS[:3] + ITEMS[4:]]


async def test_moved_bounds_are_followed(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    space = _scene(nodes).space(FILES)
    nodes.move_bounds()
    await space.put_many(ITEMS)
    assert len(nodes.records) == len(ITEMS)
    assert [location async for location in space.query()] == PLACES


async def test_busy_and_returning_nodes_are_waited_for(autojump_clock: MockClock) -> None:
    nodes = FakeNodes(away={"127.0.0.3"})
    nodes.busy["127.0.0.2"] = 2
    space = _scene(nodes).space(FILES)
    async with trio.open_nursery() as nursery:
        nursery.start_soon(space.put_many, ITEMS)
        await trio.sleep(0.3)
        nodes.away.clear()
    assert await space.get_many(PLACES) == [payload for _, payload in ITEMS]


async def test_a_node_that_stays_away_is_an_error_in_bounded_time(autojump_clock: MockClock) -> None:
    nodes = FakeNodes(away={"127.0.0.3"})
    space = _scene(nodes).space(FILES)
    with trio.fail_after(30), pytest.raises(Unreachable):
        await space.put_many(ITEMS)
    nodes.away = set(nodes.addresses)
    with trio.fail_after(30), pytest.raises(Unreachable, match="no node of the cluster answers"):
        await space.get(FIRST)


async def test_a_lost_reply_is_asked_for_again_with_the_same_bytes(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    space = _scene(nodes).space(FILES)
    assert await space.get(FIRST) is None
    nodes.lost_replies = 1
    await space.put(FIRST, b"once", expect=ABSENT)
    sent = [packet.items for _, packet in nodes.asked if isinstance(packet, PutMany)]
    assert len(sent) == 2
    assert sent[0] == sent[1]


async def test_a_later_put_replaces_whatever_the_clock_says(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    ahead, space = _scene(nodes), _scene(nodes).space(FILES)
    ahead.access.sequencer.saw(2**62, 2**62 / 1e6)
    await ahead.space(FILES).put(FIRST, b"from a clock that is ahead")
    await space.put(FIRST, b"newer")
    assert await space.get(FIRST) == b"newer"


async def test_who_chose_the_highest_version_holds_one_place_and_no_other_one(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    hostile, reader, other = (_scene(nodes) for _ in range(3))
    hostile.access.sequencer.saw(SEQ_MAX - 1, SEQ_MAX / 1e6)
    await hostile.space(FILES).put(FIRST, b"for ever")
    assert await reader.space(FILES).get(FIRST) == b"for ever"
    for number in range(3):
        await reader.space(FILES).put(LAST, b"read %d" % number)
        await other.space(FILES).put(LAST, b"other %d" % number)
    assert await reader.space(FILES).get(LAST) == b"other 2"
    assert RecordHeader.decode(nodes.records[FILES, LAST].header).seq < 2**62
    with pytest.raises(Refused, match=r"highest version.*the last to write there was the key"):
        await reader.space(FILES).put(FIRST, b"mine")
    later = replace(reader.access.identity, position=2)
    await Scene(replace(reader.access, identity=later)).space(FILES).put(FIRST, b"after a change of the scene")
    assert await Scene(replace(reader.access, identity=later)).space(FILES).get(FIRST) == b"after a change of the scene"


async def test_who_was_led_to_the_highest_version_is_not_called_its_author(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    hostile, honest, third = (_scene(nodes) for _ in range(3))
    hostile.access.sequencer.saw(SEQ_MAX - 2, SEQ_MAX / 1e6)
    await hostile.space(FILES).put(FIRST, b"the highest but one")
    await honest.space(FILES).put(FIRST, b"led to the highest")
    assert RecordHeader.decode(nodes.records[FILES, FIRST].header).seq == SEQ_MAX
    with pytest.raises(Refused, match="who need not have chosen that number") as refused:
        await third.space(FILES).put(FIRST, b"mine")
    assert "revoke" not in refused.value.remedy and "any change of the scene" in refused.value.remedy


async def test_of_several_payloads_for_a_place_with_a_high_version_the_last_one_stays(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    ahead, space = _scene(nodes), _scene(nodes).space(FILES)
    ahead.access.sequencer.saw(2**62, 2**62 / 1e6)
    await ahead.space(FILES).put(FIRST, b"from a clock that is ahead")
    await space.put_many([(FIRST, b"%d" % number) for number in range(9)])
    assert await space.get(FIRST) == b"8"


async def test_expectations_are_judged(autojump_clock: MockClock) -> None:
    space = _scene(FakeNodes()).space(FILES)
    digest = await space.put(FIRST, b"one", expect=ABSENT)
    with pytest.raises(Refused, match="there is a record already") as refused:
        await space.put(FIRST, b"two", expect=ABSENT)
    assert refused.value.reason == RejectReason.STALE_VERSION
    await space.put(FIRST, b"three", expect=digest)
    with pytest.raises(Refused, match="another version"):
        await space.put(FIRST, b"four", expect=digest)
    assert await space.get(FIRST) == b"three"


async def test_what_is_expected_is_signed(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    space = _scene(nodes).space(FILES)
    first = await space.put(FIRST, b"one", expect=ABSENT)
    gone = await space.delete(FIRST, expect=first)
    await space.put(FIRST, b"two")
    sent = [RecordHeader.decode(packet.items[0].header) for _, packet in nodes.asked if isinstance(packet, PutMany)]
    assert [header.expects for header in sent] == [EXPECTS_NOTHING, first, EXPECTS_ANYTHING]
    assert [header.digest for header in sent[:2]] == [first, gone]


async def test_another_expectation_is_another_record(autojump_clock: MockClock) -> None:
    """What was deleted counts as nothing: the second try names it."""
    nodes = FakeNodes()
    space = _scene(nodes).space(FILES)
    await space.put(FIRST, b"one")
    gone = await space.delete(FIRST)
    before = len(nodes.asked)
    await space.put(FIRST, b"two", expect=ABSENT)
    sent = [RecordHeader.decode(packet.items[0].header) for _, packet in nodes.asked[before:] if isinstance(packet, PutMany)]
    assert [header.expects for header in sent] == [EXPECTS_NOTHING, gone]
    assert len({(header.seq, header.nonce, header.digest) for header in sent}) == 2


@pytest.mark.parametrize("expect", [bytes(32), b"", b"short"])
async def test_what_is_no_expectation_replaces_nothing(autojump_clock: MockClock, expect: bytes) -> None:
    space = _scene(FakeNodes()).space(FILES)
    await space.put(FIRST, b"one")
    with pytest.raises(LocalFault):
        await space.put(FIRST, b"two", expect=expect)
    assert await space.get(FIRST) == b"one"


async def test_an_expected_version_is_replaced_whatever_the_clock_says(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    ahead, behind, reader = (_scene(nodes) for _ in range(3))
    wall = ahead.access.calls.world.clock.wall()
    ahead.access.sequencer.saw(int((wall + 3600) * 1e6), wall + 3600)
    digest = await ahead.space(FILES).put(FIRST, b"from a clock that is ahead")
    digest = await behind.space(FILES).put(FIRST, b"in its stead", expect=digest)
    with pytest.raises(Refused, match="another version"):
        await behind.space(FILES).put(FIRST, b"too late", expect=b"\1" * 32)
    assert await reader.space(FILES).get(FIRST) == b"in its stead"
    before = len(nodes.asked)
    await reader.space(FILES).put(FIRST, b"last", expect=digest)
    assert len(nodes.asked) == before + 1, "what was read is known to be older"


async def test_of_several_payloads_for_one_place_the_last_one_stays(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    space = _scene(nodes).space(FILES)
    await space.put_many([(FIRST, b"first"), *ITEMS[1:], (FIRST, b"last")])
    assert await space.get(FIRST) == b"last"
    sent = [item for _, packet in nodes.asked if isinstance(packet, PutMany) for item in packet.items]
    assert [item.location for item in sent].count(FIRST) == 1


async def test_fresh_records_overwrite_nothing_and_equal_ones_are_kept(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    scene = _scene(nodes)
    items = [FreshItem(FILES, place, b"atom %d" % index) for index, place in enumerate([FIRST, FIRST, PLACES[3], LAST])]
    first = await put_fresh(scene.access, items)
    assert [stored.location.number for stored in first] == [0, 1, PLACES[3].number, LAST.number]
    again = await put_fresh(_scene(nodes).access, items)
    assert [(stored.location, stored.reused) for stored in again] == [(stored.location, True) for stored in first]
    other = await put_fresh(_scene(nodes).access, [FreshItem(FILES, FIRST, b"another"), FreshItem(FILES, LAST, b"last")])
    assert {stored.location.number for stored in other} == {2, 3}
    assert len(nodes.records) == 6


async def test_many_records_go_in_few_frames_and_short_replies_are_continued(autojump_clock: MockClock) -> None:
    nodes = FakeNodes(addresses=("127.0.0.2",), reply_records_max=3)
    space = _scene(nodes).space(FILES)
    big = [(place, bytes([index]) * 60_000) for index, place in enumerate(PLACES)]
    await space.put_many(big)
    assert sum(isinstance(packet, PutMany) for _, packet in nodes.asked) == 1
    assert await space.get_many(PLACES) == [payload for _, payload in big]
    assert sum(isinstance(packet, GetMany) for _, packet in nodes.asked) == 10


async def test_ranges_come_in_pieces_and_are_halved_when_too_large(autojump_clock: MockClock) -> None:
    nodes = FakeNodes(range_max=2)
    space = _scene(nodes).space(FILES)
    await space.put_many(ITEMS)
    assert [location async for location in space.query()] == PLACES
    assert [location async for location in space.query(PLACES[4], PLACES[6])] == PLACES[4:7]


async def test_records_of_another_place_or_writer_are_not_believed(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    space = _scene(nodes).space(FILES)
    await space.put(PLACES[0], b"here")
    moved = nodes.records[FILES, PLACES[0]]
    nodes.records[FILES, PLACES[1]] = moved
    with pytest.raises(DamagedData, match=PLACES[1].hex()):
        await space.get(PLACES[1])
    nodes.records[FILES, PLACES[0]] = replace(moved, ciphertext=bytes(len(moved.ciphertext)))
    with pytest.raises(DamagedData):
        await space.get(PLACES[0])
    stranger = SigningKey(bytes(31) + b"\2")
    await _scene(nodes, stranger).space(FILES).put(PLACES[2], b"forged")
    with pytest.raises(DamagedData, match="no writer"):
        await space.get(PLACES[2])


async def test_a_payload_that_fits_no_record_is_refused_before_anything_is_sent(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    with pytest.raises(LocalFault, match="do not fit"):
        await _scene(nodes).space(FILES).put_many([(FIRST, b"small"), (LAST, bytes(61_441))])
    assert nodes.records == {}


async def test_with_keys_alone_a_scene_can_be_read_and_not_written(autojump_clock: MockClock) -> None:
    nodes = FakeNodes()
    secrets = secrets_of(WRITER)
    maker = maker_of("user:owner", secrets)
    kept = born("kitchen", maker, secrets.signing, ORIGIN, nodes.calls().world.entropy.token)
    keys = kept_keys(kept, secrets.sealing)
    proposed = first_header(kept, keys, maker, ORIGIN)
    assert proposed is not None
    header = decided(proposed, KEEPER_KEY)
    identity = SceneIdentity(keys.scene_id, keys.genesis, 1, {WRITER.key_id: WriterKey.always(WRITER.public)}, keys.epochs)
    await Scene(SceneAccess(nodes.calls(), "kitchen", identity, WRITER)).space(FILES).put(FIRST, b"hello")
    calls = nodes.calls()
    members = [(owner.node_id, owner.address) for owner in calls.table.owners]
    reader = open_scene_with_keys(calls.world, calls._links, members, header, keys.epochs)
    assert await reader.space(FILES).get(FIRST) == b"hello"
    with pytest.raises(LocalFault, match="reading only"):
        await reader.space(FILES).put(FIRST, b"bye")
    for forged in (replace(header, private_key=KeyId(5)), proposed, decided(proposed, WRITER)):
        with pytest.raises(DamagedData):
            open_scene_with_keys(calls.world, calls._links, members, forged, keys.epochs)


async def test_a_deletion_is_as_long_as_the_record_that_it_takes_the_place_of() -> None:
    nodes = FakeNodes()
    space = _scene(nodes).space(FILES)
    sizes = (20, 500, 2_999)
    for place, size in zip(PLACES, sizes, strict=False):
        await space.put(place, b"x" * size)
    before = {place: len(item.ciphertext) for (_, place), item in nodes.records.items()}
    for place in PLACES[: len(sizes)]:
        await space.delete(place)
        assert await space.get(place) is None
    assert {place: len(item.ciphertext) for (_, place), item in nodes.records.items()} == before
    # A client that has only read it knows, too.
    await space.put(PLACES[9], b"y" * 1_234)
    other = _scene(nodes).space(FILES)
    assert len(await other.get(PLACES[9]) or b"") == 1_234
    await other.delete(PLACES[9])
    assert len(nodes.records[FILES, PLACES[9]].ciphertext) == 1_234 + 16
