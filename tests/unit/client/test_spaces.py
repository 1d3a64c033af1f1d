"""If this fails, spaces are made twice or not at all, their records are looked for where they are not, or one author undoes another."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from trio.testing import MockClock

from scenefold.base.errors import DamagedData, LocalFault, Refused, Unreachable, UsageFault
from scenefold.base.ids import NodeId
from scenefold.base.limits import COPIES_DEFAULT, COPIES_MIN_DEFAULT
from scenefold.base.location import LINE_LENGTH, Location
from scenefold.base.reasons import RejectReason
from scenefold.client.copies import is_so_already, new_copies
from scenefold.client.new_space import new_space
from scenefold.client.scene import Scene
from scenefold.client.scenes import Scenes
from scenefold.crypto import HEADER_DOMAIN, RecordHeader, SigningKey
from scenefold.scene.layout import GEOMETRY, SPACES
from scenefold.scene.log import Layouts, decided
from scenefold.simulation.clients import secrets_of
from scenefold.wire import Batch, CreateSpace, ProposeSceneLog, RequestSceneLog, ScaleSpace, SceneMode, SetCopies, SetMode, Want
from scenefold.world.keyring import Keyring
from unit.client.fake_nodes import KEEPER_KEY, ORIGIN, FakeNodes

WRITER = SigningKey(bytes(31) + b"\1")
BOX = ((0.0, 0.0, 0.0), (8.0, 8.0, 8.0))


def scenes_of(nodes: FakeNodes, folder: Path) -> Scenes:
    return Scenes(nodes.calls(), Keyring(folder), secrets_of(WRITER), ORIGIN)


async def scene_of(nodes: FakeNodes, folder: Path, copies: int | None = None) -> Scene:
    return await scenes_of(nodes, folder).open_or_create("kitchen", copies=copies)


async def test_a_scene_begins_with_the_spaces_of_the_layout(autojump_clock: MockClock, tmp_path: Path) -> None:
    scene = await scene_of(FakeNodes(), tmp_path)
    spaces = [space for space in await scene.spaces() if not space.parent]
    assert [(space.id, space.name) for space in spaces] == [(space.id, space.name) for space in SPACES]
    assert {(space.copies, space.copies_min) for space in spaces} == {(COPIES_DEFAULT, COPIES_MIN_DEFAULT)}
    assert scene.access.identity.layouts.lacking() == {}
    assert (await scene.space_named("geometry")).id == (await scene.space_named(2)).id == GEOMETRY


async def test_a_space_is_made_moved_and_asked_by_box(autojump_clock: MockClock, tmp_path: Path) -> None:
    nodes = FakeNodes()
    scene = await scene_of(nodes, tmp_path)
    hall = await scene.create_space("hall", BOX)
    assert (hall.id, (await hall.info()).dimensions) == (31, 3), "behind the shadows of the spaces that every scene has"
    points = np.random.default_rng(3).random((60, 3)) * 8
    places = await hall.put_all_at([(point, b"%d" % index) for index, point in enumerate(points.tolist())])
    assert len(set(places)) == 60
    await hall.translate((100.0, 0.0, 0.0))
    moved = await hall.scale(2.0)
    assert (moved.transform.factor, moved.transform.offset) == (2.0, (200.0, 0.0, 0.0))
    there = points * 2 + [200.0, 0.0, 0.0]
    low, high = [202.0, 3.0, 1.0], [212.0, 12.0, 14.0]
    found = {item.location: item.position async for item in hall.query_box(low, high)}
    inside = ((there >= low) & (there <= high)).all(axis=1)
    assert set(found) == {place for place, kept in zip(places, inside, strict=True) if kept}
    for place, point, kept in zip(places, there, inside, strict=True):
        if kept:
            np.testing.assert_allclose(found[place], point, atol=1e-9)
    assert await hall.get(places[7]) == b"7", "nothing was moved"
    other = await (await scene_of(nodes, tmp_path)).space_named("hall")
    assert {item.location async for item in other.query_box(low, high)} == set(found)


async def test_records_at_one_position_are_all_found_there(autojump_clock: MockClock, tmp_path: Path) -> None:
    scene = await scene_of(FakeNodes(), tmp_path)
    for dimensions in (1, 4, 8):
        space = await scene.create_space(f"space of {dimensions}", ((0.0,) * dimensions, (1.0,) * dimensions))
        point = (0.3,) * dimensions
        places = [await space.put_at(point, b"one"), await space.put_at(point, b"two")]
        assert len({item.location async for item in space.query_box(point, point)} & set(places)) == 2


async def test_records_are_of_the_kind_of_their_space(autojump_clock: MockClock, tmp_path: Path) -> None:
    scene = await scene_of(FakeNodes(), tmp_path)
    hall, results = await scene.create_space("hall", BOX), await scene.create_space("results", node_managed=True)
    with pytest.raises(LocalFault, match="the nodes choose where records of this space lie"):
        await results.put(Location.from_number(5), b"here")
    with pytest.raises(LocalFault, match="the nodes choose"):
        await results.delete(Location.from_number(5))
    with pytest.raises(LocalFault, match="the nodes choose"):
        await results.put_at((0.5, 0.5, 0.5), b"here")
    with pytest.raises(LocalFault, match="lie where you put them"):
        await hall.put_managed(b"anywhere")
    place = await results.put_managed(b"anywhere")
    assert [found async for found in results.managed.query()] == [place]


async def test_what_lies_in_a_managed_space_is_listed_by_place_too_until_it_is_deleted(autojump_clock: MockClock, tmp_path: Path) -> None:
    results = await (await scene_of(FakeNodes(), tmp_path)).create_space("results", node_managed=True)
    place = await results.put_managed(b"anywhere")
    assert [location async for location in results.query()] == [place.location]
    await results.managed.delete(place)
    assert [location async for location in results.query()] == []
    assert [location async for location in results.query(deleted=True)] == [place.location]


async def test_records_say_under_which_position_they_were_written(autojump_clock: MockClock, tmp_path: Path) -> None:
    nodes = FakeNodes()
    scene = await scene_of(nodes, tmp_path)
    hall = await scene.create_space("hall", BOX)
    place = await hall.put_at((1.0, 2.0, 3.0), b"a")
    header = RecordHeader.decode(nodes.records[hall.id, place].header)
    assert (header.epoch, header.content_position) == (2, 2)
    other = await (await scene_of(nodes, tmp_path)).space_named("hall")
    await other.translate((1.0, 0.0, 0.0))
    written = await hall.put(place, b"b")
    header = RecordHeader.decode(nodes.records[hall.id, place].header)
    assert (header.epoch, header.content_position, header.digest) == (2, 2, written), "this client knows no more yet"
    (opened,) = await hall.read([place])
    assert opened is not None and (opened.payload, opened.content_position) == (b"b", 2)
    np.testing.assert_array_equal((await hall.info()).fast_forward([[1.0, 2.0, 3.0]], opened.content_position), [[2.0, 2.0, 3.0]])


async def test_the_log_is_read_whole_only_when_it_changed(autojump_clock: MockClock, tmp_path: Path) -> None:
    nodes = FakeNodes()
    scene, other = await scene_of(nodes, tmp_path), await scene_of(nodes, tmp_path)
    await scene.create_space("hall", BOX)

    def logs_read() -> int:
        return sum(isinstance(packet, RequestSceneLog) and packet.want is Want.LOG for _, packet in nodes.asked)

    await scene.spaces()
    before = logs_read()
    for _ in range(5):
        assert [space.name for space in await scene.spaces() if not space.parent][-1] == "hall"
    assert logs_read() == before
    await other.create_space("attic", BOX)
    before = logs_read()
    assert [space.name for space in await scene.spaces() if not space.parent][-2:] == ["hall", "attic"]
    assert logs_read() == before + 1


async def test_two_authors_at_once_both_get_in(autojump_clock: MockClock, tmp_path: Path) -> None:
    nodes = FakeNodes()
    scene, other = await scene_of(nodes, tmp_path), await scene_of(nodes, tmp_path)
    hall = await scene.create_space("hall", BOX)
    before = dict(nodes.headers), dict(nodes.logs)
    await (await other.space_named("hall")).translate((1.0, 0.0, 0.0))
    fast = dict(nodes.headers), dict(nodes.logs)
    nodes.headers, nodes.logs = dict(before[0]), dict(before[1])

    def overtake() -> None:
        nodes.headers, nodes.logs = fast

    nodes.before_proposals = [overtake]
    moved = await hall.scale(3.0)
    assert (moved.transform.factor, moved.transform.offset) == (3.0, (3.0, 0.0, 0.0))
    assert nodes.headers[scene.id].position == 4


async def test_a_change_whose_answer_was_lost_is_made_once(autojump_clock: MockClock, tmp_path: Path) -> None:
    nodes = FakeNodes()
    hall = await (await scene_of(nodes, tmp_path)).create_space("hall", BOX)

    def lose_replies() -> None:
        nodes.lost_replies = 100

    nodes.before_proposals = [lose_replies]
    with pytest.raises(Unreachable, match="answer to a change was lost"):
        await hall.translate((1.0, 0.0, 0.0))
    nodes.lost_replies = 0
    assert (await hall.info()).transform.offset == (1.0, 0.0, 0.0)

    def lose_some() -> None:
        nodes.lost_replies = 2

    nodes.before_proposals = [lose_some]
    assert (await hall.translate((1.0, 0.0, 0.0))).transform.offset == (2.0, 0.0, 0.0)


async def test_without_the_keeper_of_the_log_it_is_said_who_is_missing(autojump_clock: MockClock, tmp_path: Path) -> None:
    nodes = FakeNodes()
    scene = await scene_of(nodes, tmp_path)
    nodes.away = {"127.0.0.2"}
    with pytest.raises(Unreachable, match=r"keeps the scene's log does not answer.*127\.0\.0\.2"):
        await scene.spaces()
    nodes.away = set()
    nodes.logs.clear()
    with pytest.raises(Unreachable, match="has lost it"):
        await scene.spaces()


async def test_a_log_of_another_position_is_not_believed(autojump_clock: MockClock, tmp_path: Path) -> None:
    nodes = FakeNodes()
    scene, other = await scene_of(nodes, tmp_path), await scene_of(nodes, tmp_path)
    older = dict(nodes.logs)
    await scene.create_space("hall", BOX)
    nodes.logs = older
    with pytest.raises(DamagedData, match="not the one that its header names"):
        await other.spaces()


async def test_who_signs_under_an_old_position_learns_the_new_one(autojump_clock: MockClock, tmp_path: Path) -> None:
    nodes = FakeNodes()
    scene, other = await scene_of(nodes, tmp_path), await scene_of(nodes, tmp_path)
    hall = await scene.create_space("hall", BOX, render_output=True)
    await other.access.change_log(lambda _: SetMode(SceneMode.RENDER))
    assert await hall.put_at((1.0, 1.0, 1.0), b"output")
    with pytest.raises(Refused, match="render mode") as refused:
        await scene.space(10).put(await hall.put_at((2.0, 2.0, 2.0), b"output"), b"edit")
    assert refused.value.reason is RejectReason.MODE_FORBIDS
    await other.access.change_log(lambda _: SetMode(SceneMode.EDIT))
    place = Location.from_number(77)
    await scene.space(10).put(place, b"edit")
    assert RecordHeader.decode(nodes.records[10, place].header).epoch == 4


@pytest.mark.parametrize(
    ("arguments", "options", "complaint"),
    [
        (("hall",), {"dimensions": 17}, "1 to 8 dimensions, not 17"),
        (("hall",), {"dimensions": 0}, "1 to 8 dimensions"),
        (("hall", ((0.0,) * 17, (1.0,) * 17)), {}, "1 to 8 dimensions, not 17"),
        (("hall", ((0.0, 2.0), (1.0, 1.0))), {}, "ends at 1 where it begins at 2 on axis 1"),
        (("hall", ((0.0, 0.0), (1.0,))), {}, "2 coordinates, not 2 and 1"),
        (("hall", ((0.0,), (float("nan"),))), {}, "finite"),
        (("hall", BOX), {"curve": "peano"}, "no curve 'peano'"),
        (("geometry", BOX), {}, r"a space 'geometry' already, its number is 2 \(space geometry\): .*`scenectl space list` shows"),
        (("hall", BOX), {"space_id": 2}, r"the number 2 is that of the space 'geometry' \(space hall\): .*`scenectl space list` shows"),
        (("hall", BOX), {"space_id": 9000}, "9000 lies outside"),
        (("", BOX), {}, "cannot be the name"),
        (("12", BOX), {}, "cannot be the name"),
        (("ä" * 33, BOX), {}, "cannot be the name"),
    ],
)
async def test_a_space_that_cannot_be_is_refused_with_words(
    autojump_clock: MockClock, tmp_path: Path, arguments: tuple[Any, ...], options: dict[str, Any], complaint: str
) -> None:
    nodes = FakeNodes()
    scene = await scene_of(nodes, tmp_path)
    with pytest.raises(LocalFault, match=complaint):
        await scene.create_space(*arguments, **options)
    assert sum(isinstance(packet, ProposeSceneLog) for _, packet in nodes.asked) == 1, "nothing but the scene itself was proposed"


async def test_moves_that_cannot_be_are_refused_with_words(autojump_clock: MockClock, tmp_path: Path) -> None:
    scene = await scene_of(FakeNodes(), tmp_path)
    hall = await scene.create_space("hall", BOX)
    with pytest.raises(LocalFault, match="offset of 2 coordinates in a space of 3"):
        await hall.translate((1.0, 2.0))
    for factor in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(LocalFault, match="factor"):
            await hall.scale(factor)
    with pytest.raises(LocalFault, match="holds imported content"):
        await scene.space(GEOMETRY).scale(2.0)
    with pytest.raises(LocalFault, match="no such space"):
        await scene.space(99).scale(2.0)
    with pytest.raises(LocalFault, match="outside of the space"):
        await hall.put_at((9.0, 0.0, 0.0), b"")
    with pytest.raises(LocalFault, match="outside of the space"):
        _ = [found async for found in hall.query_box((9.0, 9.0, 9.0), (10.0, 10.0, 10.0))]


async def test_a_header_that_was_not_signed_by_the_scene_is_not_believed(autojump_clock: MockClock, tmp_path: Path) -> None:
    nodes = FakeNodes()
    scene = await scene_of(nodes, tmp_path)
    header = replace(nodes.headers[scene.id], position=2)
    nodes.headers[scene.id] = decided(replace(header, signature=WRITER.sign(HEADER_DOMAIN, header.signable())), KEEPER_KEY)
    with pytest.raises(DamagedData):
        await scene.access.change_log(lambda _: ScaleSpace(GEOMETRY, 2.0))


async def test_a_space_is_made_with_the_shadows_for_its_copies(autojump_clock: MockClock, tmp_path: Path) -> None:
    nodes = FakeNodes()
    scene = await scene_of(nodes, tmp_path)
    hall = await scene.create_space("hall", BOX, curve="z-order", copies=3, render_output=True)
    assert (await scene.access.read_log()).state.position == 2, "space and shadows come with one record"
    attic = await scene.create_space("attic", BOX)
    known = {space.name: space for space in await (await scene_of(nodes, tmp_path)).spaces()}
    assert (known["hall"].copies, known["hall"].copies_min) == (3, 2)
    for number in (1, 2):
        shade = known[f"hall copy {number}"]
        assert (shade.id, shade.parent, shade.offset.number) == (hall.id + number, hall.id, number * LINE_LENGTH // 3)
        assert (shade.copies, shade.copies_min) == (1, 1)
        assert (shade.dimensions, shade.curve, shade.low, shade.high) == (3, "z-order", *BOX)
    assert (attic.id, known["attic"].copies, known["attic"].copies_min) == (hall.id + 3, COPIES_DEFAULT, COPIES_MIN_DEFAULT)
    header = nodes.headers[scene.id]
    assert Layouts.of(header.spaces).offsets[hall.id] == tuple(known[f"hall copy {number}"].offset for number in (1, 2))


async def test_copies_of_a_space_change_as_often_as_somebody_likes(autojump_clock: MockClock, tmp_path: Path) -> None:
    nodes = FakeNodes()
    scene = await scene_of(nodes, tmp_path, copies=1)
    hall = await scene.create_space("hall", BOX, copies=1)

    async def layout() -> tuple[Location, ...]:
        spaces = (await scene.access.read_log()).header.spaces
        assert spaces == nodes.headers[scene.id].spaces
        return Layouts.of(spaces, scene.id).offsets[hall.id]

    said = await hall.set_copies(3)
    assert (said.copies, said.copies_min, len(await layout())) == (3, 2, 2)
    for least, expected in ((3, 3), (None, 3), (1, 1)):
        said = await hall.set_copies(3, least)
        assert (said.copies, said.copies_min, len(await layout())) == (3, expected, 2)
    position = nodes.headers[scene.id].position
    await hall.set_copies(3)
    assert nodes.headers[scene.id].position == position, "what is so already makes no record"
    had = [await layout()]
    for number, least in ((4, 1), (2, 1), (1, 1), (3, 2), (4, 2)):
        said = await hall.set_copies(number)
        assert (said.copies, said.copies_min, said.turned) == (number, least, nodes.headers[scene.id].position)
        had.append(await layout())
        assert len(had[-1]) == number - 1 and had.count(had[-1]) == 1, "nobody ever held anything by it"
    assert len([space for space in await scene.spaces() if space.parent == hall.id]) == 3, "shadows are used again"
    await scene.space(GEOMETRY).set_copies(2)
    assert (await scene.space(GEOMETRY).info()).copies == 2, "also the spaces that every scene has"


async def test_a_change_of_copies_can_be_looked_at_before(autojump_clock: MockClock, tmp_path: Path) -> None:
    nodes = FakeNodes()
    scene = await scene_of(nodes, tmp_path)
    hall = await scene.create_space("hall", BOX, copies=1)
    places = [Location.from_number(LINE_LENGTH * index // 50) for index in range(50)]
    await hall.put_many((place, b"chair") for place in places)
    await hall.delete(places[3])
    before, number = nodes.headers[scene.id], len(nodes.table.owners)
    plan = await hall.plan_copies(number + 1)
    assert plan.is_change and plan.shadows == tuple(f"hall copy {index + 1}" for index in range(number))
    made = 50 * (number - 1)
    document = plan.document()
    assert (document["records"], document["copies_to_make"], document["copies_to_drop"]) == (50, made, 0), "there are no more nodes"
    assert nodes.headers[scene.id] == before
    said = await hall.set_copies(number + 1)
    assert (plan.copies, plan.copies_min) == (said.copies, said.copies_min)
    assert tuple(space.name for space in await scene.spaces() if space.parent == hall.id) == plan.shadows
    back = (await hall.plan_copies(1)).document()
    assert (back["copies_to_make"], back["copies_to_drop"], back["shadows_to_make"]) == (0, made, [])
    same = await hall.plan_copies(number + 1)
    assert not same.is_change and same.document()["copies_to_make"] == 0
    with pytest.raises(UsageFault, match="a space has 1 to 8 copies"):
        await hall.plan_copies(9)


async def test_a_space_that_may_have_records_shares_its_holders_answers_with_no_other(autojump_clock: MockClock, tmp_path: Path) -> None:
    """Whoever holds copies of another space of the same layout would say that there are none of this one's."""
    nodes = FakeNodes()
    scene = await scene_of(nodes, tmp_path)
    await scene.create_space("new", BOX, copies=3)
    halls = [await scene.create_space(name, BOX, copies=1) for name in ("hall", "attic")]
    for hall in halls:
        await hall.set_copies(3)
    spaces = (await scene.access.read_log()).header.spaces
    layouts = [offsets for offsets in Layouts.of(spaces, scene.id).offsets.values() if offsets]
    assert len({offset for offsets in layouts for offset in offsets}) == 6
    thirds = [LINE_LENGTH * third // 3 for third in (1, 2)]
    assert all(0 <= offset.number - third < LINE_LENGTH >> 40 for offsets in layouts for offset, third in zip(offsets, thirds, strict=True))


async def test_nobody_writes_to_a_shadow_reads_or_lists_it_or_says_how_many_copies_it_has(
    autojump_clock: MockClock, tmp_path: Path
) -> None:
    nodes = FakeNodes()
    scene = await scene_of(nodes, tmp_path)
    hall = await scene.create_space("hall", BOX, copies=2)
    shade = await scene.space_named("hall copy 1")
    before = len(nodes.asked)

    async def listed() -> None:
        _ = [location async for location in shade.query()]

    place = Location(bytes(20))
    calls = {
        "write to": [partial(shade.put, place, b"x"), partial(shade.delete, place)],
        "read": [partial(shade.get, place), partial(shade.read, [place])],
        "list": [listed],
    }
    for verb, tries in calls.items():
        for call in tries:
            with pytest.raises(UsageFault, match=f"{verb} space {hall.id}, whose shadow it is"):
                await call()
    assert len(nodes.asked) == before
    with pytest.raises(LocalFault, match="'hall copy 1' holds the copies of the space 'hall'"):
        await shade.set_copies(2)
    with pytest.raises(LocalFault, match=f"is a shadow: its addresses mean what they mean in space {hall.id}"):
        await shade.translate((1.0, 0.0, 0.0))
    with pytest.raises(LocalFault, match="no such space"):
        await scene.space(99).set_copies(2)
    with pytest.raises(LocalFault, match=f"space {hall.id} has 2 copies, and the shadows that those take"):
        await scene.create_space("more", parent="hall")
    with pytest.raises(LocalFault, match=f"space {shade.id} is a shadow itself.*name space {hall.id}"):
        await scene.create_space("deeper", parent="hall copy 1")


@pytest.mark.parametrize("copies", [0, 9, 256, -1])
async def test_no_space_has_so_many_copies(autojump_clock: MockClock, tmp_path: Path, copies: int) -> None:
    nodes = FakeNodes()
    scene = await scene_of(nodes, tmp_path)
    before = len(nodes.asked)
    for least in (None, 1, 2):
        with pytest.raises(UsageFault, match="a space has 1 to 8 copies"):
            await scene.space(11).set_copies(copies, least)
    assert len(nodes.asked) == before


async def test_a_space_that_was_told_of_copies_before_there_were_any_gets_its_shadows(autojump_clock: MockClock, tmp_path: Path) -> None:
    """Early programs wrote the number into the log, and shadows only if told to."""
    nodes = FakeNodes()
    scene = await scene_of(nodes, tmp_path)
    hall = await scene.create_space("hall", BOX, copies=1)
    log = (await scene.access.read_log()).state
    early = log.extended([log.next_record(SetCopies(hall.id, 3, 2), b"r" * 16, NodeId(1))])
    made = new_space("shade", parent="hall")(early)
    assert isinstance(made, CreateSpace) and made.offset == Location(b"\x80" + bytes(19))
    change = new_copies(hall.id, 3, 2)(early)
    assert isinstance(change, Batch) and not is_so_already(change, early)
    after = early.apply(early.next_record(change, b"s" * 16, NodeId(1)))
    assert Layouts.of(after.public_spaces()).lacking() == {}


@pytest.mark.parametrize(
    ("box", "options", "complaint"),
    [
        (BOX, {"node_managed": True}, "no box"),
        (BOX, {"parent": "hall"}, "of its parent"),
        (None, {"parent": "hall", "dimensions": 3}, "of its parent"),
        (None, {"offset": Location(bytes(20))}, "only a shadow"),
        (None, {"copies": 0}, "copies"),
        (None, {"copies": 9}, "1 to 8 copies"),
        (None, {"parent": "hall", "copies": 2}, "a shadow is one copy itself"),
        (None, {"copies": 2, "copies_min": 3}, "not 3 of 2"),
        (None, {"copies_min": 0}, "not 0 of 3"),
        (None, {"dimensions": 17}, "1 to 8 dimensions, not 17"),
        (((0.0,) * 2, (1.0,) * 3), {}, "coordinates"),
        (((0.0, 2.0), (1.0, 1.0)), {}, "begins at 2"),
        (((0.0,), (float("nan"),)), {}, "finite"),
    ],
)
async def test_what_no_space_can_be_is_said_before_anything_is_sent(
    autojump_clock: MockClock, tmp_path: Path, box: Any, options: Any, complaint: str
) -> None:
    nodes = FakeNodes()
    scene = await scene_of(nodes, tmp_path)
    before = len(nodes.asked)
    with pytest.raises(UsageFault, match=complaint):
        await scene.create_space("attic", box, **options)
    assert len(nodes.asked) == before
