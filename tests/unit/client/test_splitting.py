"""If this fails, a record that is split reads as another one or not at all, or its parts are lost, left behind, or shown as records."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from trio.testing import MockClock

from scenefold.base.errors import DamagedData, LocalFault, Refused, UsageFault
from scenefold.base.limits import PAYLOAD_BYTES_MAX
from scenefold.base.location import Location
from scenefold.base.reasons import RejectReason
from scenefold.client.fresh import FreshItem, put_fresh
from scenefold.client.scene import Scene
from scenefold.client.space import ABSENT
from scenefold.scene.layout import FILES, GEOMETRY, RENDERS
from scenefold.scene.payloads.geometry import decode_atom
from scenefold.scene.payloads.splits import Cut, decode_entry, is_split
from scenefold.wire import Role, SceneMode, SetMode
from unit.client.splits_made import AT, atom, hall_of, listed, lying, part_places
from unit.client.test_grants import Studio, card_of

WHOLE = bytes(range(256)) * 40


@pytest.fixture
def studio(tmp_path: Path) -> Studio:
    return Studio(tmp_path)


async def kitchen(studio: Studio) -> Scene:
    return await studio.scenes(1).create("kitchen", copies=1)


async def test_a_split_record_reads_as_before_wherever_it_is_read(autojump_clock: MockClock, studio: Studio) -> None:
    scene = await kitchen(studio)
    files = scene.space(FILES)
    await files.put(AT, WHOLE)
    (before,) = await files.read([AT])
    report = await files.split(AT, 3)
    assert (report.changed, report.cut, report.bytes, len(set(report.parts))) == (True, Cut.BYTES, len(WHOLE), 3)
    there = await lying(files)
    assert set(there) == {AT, *report.parts} and is_split(there[AT].payload)
    fresh = (await studio.kitchen(1)).space(FILES)
    for space in (files, fresh):
        assert await space.get(AT) == await space.get(AT, any_copy=True) == WHOLE
        (after,) = await space.read([AT])
        assert before is not None and after is not None
        assert (after.payload, after.content_position) == (WHOLE, before.content_position)
        assert after.digest == there[AT].digest != before.digest, "it is what an edit would replace"
        assert await listed(space) == [AT]
    assert b"".join([await files.get(part) or b"" for part in report.parts]) == WHOLE, "parts by themselves are pieces of it"


async def test_merging_undoes_splitting_and_leaves_nothing(autojump_clock: MockClock, studio: Studio) -> None:
    files = (await kitchen(studio)).space(FILES)
    for payload in (WHOLE, b"ab", bytes(PAYLOAD_BYTES_MAX)):
        await files.put(AT, payload)
        split = await files.split(AT)
        merged = await files.merge(AT)
        assert (merged.changed, merged.parts) == (True, split.parts)
        there = await lying(files)
        assert list(there) == [AT] and there[AT].payload == payload


async def test_what_is_done_already_stays_as_it_is(autojump_clock: MockClock, studio: Studio) -> None:
    files = (await kitchen(studio)).space(FILES)
    await files.put(AT, WHOLE)
    assert (await files.merge(AT)).changed is False
    split = await files.split(AT)
    there = await lying(files)
    again = await files.split(AT)
    assert (again.changed, again.parts) == (False, split.parts)
    assert await lying(files) == there
    with pytest.raises(LocalFault, match="split already, into 2 parts by bytes"):
        await files.split(AT, 3)
    with pytest.raises(LocalFault, match="split already"):
        await files.split(AT, cut=Cut.TRIANGLES)


async def test_an_atom_is_cut_by_triangles_that_lie_where_they_are(autojump_clock: MockClock, studio: Studio) -> None:
    hall = await hall_of(await kitchen(studio))
    payload = atom(40)
    location = await hall.put_at((0.5, 0.5, 0.5), payload)
    await hall.translate((10.0, 0.0, 0.0))
    report = await hall.split(location, 4)
    assert report.cut is Cut.TRIANGLES
    assert await hall.get(location) == payload
    info = await hall.info()
    for place in report.parts:
        piece = decode_atom(await hall.get(place) or b"")
        used = piece.positions[np.unique(piece.triangles)]
        middle = (used.min(axis=0) + used.max(axis=0)) / 2 + [10.0, 0.0, 0.0]
        np.testing.assert_allclose(info.world_of([place])[0], middle, atol=1e-5)
    low, high = info.world_box
    assert [found.location async for found in hall.query_box(low, high)] == [location]
    assert {found.location async for found in hall.query_box(low, high, deleted=True)} == {location, *report.parts}
    assert (await hall.split(location, 4)).parts == report.parts
    await hall.merge(location)
    assert await hall.get(location) == payload and await part_places(hall) == []


async def test_an_atom_may_be_cut_by_bytes_and_bytes_not_by_triangles(autojump_clock: MockClock, studio: Studio) -> None:
    geometry = (await kitchen(studio)).space(GEOMETRY)
    await geometry.put(AT, atom(5))
    assert (await geometry.split(AT, 200, cut=Cut.BYTES)).cut is Cut.BYTES
    assert await geometry.get(AT) == atom(5)
    await geometry.merge(AT)
    assert await geometry.get(AT) == atom(5)
    await geometry.put(AT, WHOLE)
    with pytest.raises(LocalFault, match="no geometry atom"):
        await geometry.split(AT, cut=Cut.TRIANGLES)
    await geometry.put(AT, atom(5)[:-1])
    with pytest.raises(DamagedData, match=r"atom.*is cut short.*by bytes"):
        await geometry.split(AT)


async def test_a_taken_place_is_left_as_it_is(autojump_clock: MockClock, studio: Studio) -> None:
    files = (await kitchen(studio)).space(FILES)
    await files.put(AT, WHOLE)
    wanted = (await files.split(AT, dry_run=True)).parts
    assert list(await lying(files)) == [AT], "a dry run changes nothing"
    await files.put(wanted[0], b"somebody's")
    report = await files.split(AT)
    assert report.parts == (Location.from_number(wanted[0].number + 1), wanted[1])
    assert await files.get_many([AT, wanted[0]]) == [WHOLE, b"somebody's"]
    await files.merge(AT)
    assert await files.get(wanted[0]) == b"somebody's"


async def test_what_was_split_is_not_imported_twice(autojump_clock: MockClock, studio: Studio) -> None:
    geometry = (await kitchen(studio)).space(GEOMETRY)
    (stored,) = await put_fresh(geometry._access, [FreshItem(GEOMETRY, AT, atom())])
    parts = (await geometry.split(stored.location)).parts
    (again,) = await put_fresh(geometry._access, [FreshItem(GEOMETRY, AT, atom())])
    assert (again.location, again.reused) == (AT, True)
    await geometry.delete(parts[0])
    (anew,) = await put_fresh(geometry._access, [FreshItem(GEOMETRY, AT, atom())])
    assert (anew.location != AT, anew.reused) == (True, False), "what lacks a part is no record to go by"


async def test_what_cannot_be_split_is_told(autojump_clock: MockClock, studio: Studio) -> None:
    scene = await kitchen(studio)
    files = scene.space(FILES)
    for verb in (files.split, files.merge):
        with pytest.raises(LocalFault, match="there is no record"):
            await verb(AT)
    await files.put(AT, b"x")
    with pytest.raises(LocalFault, match=r"too small to split: 1 bytes make no 2 parts.*leave it whole"):
        await files.split(AT)
    await files.put(AT, b"xyz")
    with pytest.raises(LocalFault, match="ask for fewer parts"):
        await files.split(AT, 4)
    for count in (-1, 0, 1, 257):
        with pytest.raises(UsageFault, match="2 to 256 parts"):
            await files.split(AT, count)
    await files.put(AT, atom(1))
    with pytest.raises(LocalFault, match="1 triangles make no 2 parts"):
        await files.split(AT)
    await files.delete(AT)
    with pytest.raises(LocalFault, match="there is no record"):
        await files.split(AT)
    with pytest.raises(LocalFault, match="no such space"):
        await scene.space(99).split(AT)
    with pytest.raises(LocalFault, match="nodes choose"):
        await scene.space(RENDERS).split(AT)
    outputs = await scene.create_space("sums", ((0.0,), (1.0,)), render_output=True)
    with pytest.raises(LocalFault, match="renders write to this space"):
        await outputs.split(AT)
    await files.put(AT, WHOLE)
    parts = (await files.split(AT)).parts
    for verb in (files.split, files.merge):
        with pytest.raises(LocalFault, match="part of a split record"):
            await verb(parts[0])


async def test_a_missing_or_foreign_part_is_damage_that_is_named(autojump_clock: MockClock, studio: Studio) -> None:
    files = (await kitchen(studio)).space(FILES)
    await files.put(AT, WHOLE)
    parts = (await files.split(AT)).parts
    kept = studio.nodes.records[FILES, parts[1]]
    del studio.nodes.records[FILES, parts[1]]
    fresh = (await studio.kitchen(1)).space(FILES)
    for read in (lambda: fresh.get(AT), lambda: fresh.merge(AT), lambda: fresh.split(AT), lambda: fresh.read([AT])):
        with pytest.raises(DamagedData, match=f"part 1 of 2.*{parts[1].hex()}, is not there.*bring it back") as damage:
            await read()
        assert AT.hex() in damage.value.where
    await fresh.put(parts[1], b"something else")
    with pytest.raises(DamagedData, match="was replaced"):
        await fresh.get(AT)
    studio.nodes.records[FILES, parts[1]] = kept
    studio.nodes.rotten.add(parts[0])
    with pytest.raises(Refused, match="damaged at its owner"):
        await (await studio.kitchen(1)).space(FILES).get(AT)


async def test_a_damaged_record_is_not_split(autojump_clock: MockClock, studio: Studio) -> None:
    files = (await kitchen(studio)).space(FILES)
    await files.put(AT, WHOLE)
    studio.nodes.rotten.add(AT)
    for verb in (files.split, files.merge):
        with pytest.raises(Refused, match="damaged at its owner"):
            await verb(AT)
    assert len(studio.nodes.records) == 1


@pytest.mark.parametrize("verb", ["split", "merge", "tidy"])
async def test_nothing_is_written_in_render_mode_nor_by_a_reader(autojump_clock: MockClock, studio: Studio, verb: str) -> None:
    scene = await kitchen(studio)
    files = scene.space(FILES)
    await files.put(AT, WHOLE)
    if verb == "merge":
        await files.split(AT)
    await scene.grant(card_of(2), Role.READER)
    reader = (await studio.kitchen(2)).space(FILES)
    arguments = () if verb == "tidy" else (AT,)
    before = dict(studio.nodes.records)
    with pytest.raises(LocalFault, match="reading only"):
        await getattr(reader, verb)(*arguments)
    await scene.access.change_log(lambda _: SetMode(SceneMode.RENDER))
    with pytest.raises(Refused, match="render mode") as refused:
        await getattr(files, verb)(*arguments)
    assert refused.value.reason is RejectReason.MODE_FORBIDS
    assert studio.nodes.records == before
    assert await reader.get(AT) == await files.get(AT) == WHOLE


async def test_a_split_record_is_edited_deleted_and_removed_like_any_other(autojump_clock: MockClock, studio: Studio) -> None:
    files = (await kitchen(studio)).space(FILES)
    await files.put(AT, WHOLE)
    await files.split(AT)
    with pytest.raises(Refused, match="a record already"):
        await files.put(AT, b"new", expect=ABSENT)
    (found,) = await files.read([AT])
    assert found is not None
    await files.put(AT, b"new", expect=found.digest)
    assert await files.get(AT) == b"new"
    assert len(await part_places(files)) == 2, "an edit knows nothing of them"
    assert (await files.tidy()).removed == 2
    await files.split(AT)
    assert await files.remove(AT) is True
    assert await lying(files) == {} and await files.remove(AT) is False


async def test_a_key_that_changes_is_no_matter(autojump_clock: MockClock, studio: Studio) -> None:
    scene = await kitchen(studio)
    files = scene.space(FILES)
    await files.put(AT, WHOLE)
    parts = (await files.split(AT)).parts
    await scene.rotate_key()
    assert (await scene.reencrypt()).renewed == 3
    assert await (await studio.kitchen(1)).space(FILES).get(AT) == WHOLE
    assert (await files.tidy()).document()["in_use"] == 2
    assert (await files.split(AT)).parts == parts
    await files.merge(AT)
    assert list(await lying(files)) == [AT]


async def test_parts_are_of_the_version_that_they_were_made_from(autojump_clock: MockClock, studio: Studio) -> None:
    files = (await kitchen(studio)).space(FILES)
    await files.put(AT, WHOLE)
    first = (await files.split(AT)).parts
    await files.merge(AT)
    second = (await files.split(AT)).parts
    assert not set(first) & set(second), "nobody takes the parts of one splitting for those of another"
    assert decode_entry((await lying(files))[AT].payload).length == len(WHOLE)


async def test_an_archive_carries_split_records_and_they_are_merged_where_it_is_brought_back(
    autojump_clock: MockClock, studio: Studio, tmp_path: Path
) -> None:
    scene = await kitchen(studio)
    files = scene.space(FILES)
    for number in (1, 2):
        await files.put(Location.from_number(number), WHOLE)
        await files.split(Location.from_number(number))
    await files.put(Location.from_number(2), b"an edit, which leaves two parts over")
    await scene.export(tmp_path / "kitchen.tar")
    back, _ = await Studio(tmp_path / "elsewhere").scenes(1).import_archive("pantry", tmp_path / "kitchen.tar")
    pantry = back.space(FILES)
    assert await pantry.get_many([Location.from_number(1), Location.from_number(2)]) == await files.get_many(await listed(files))
    report = await pantry.tidy()
    assert (report.in_use, report.left_over, report.removed) == (2, 2, 2), "what was made in another scene names no version of this one"
    await pantry.merge(Location.from_number(1))
    assert await pantry.get(Location.from_number(1)) == WHOLE
    assert len(await lying(pantry)) == 2
