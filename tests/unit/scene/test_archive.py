"""If one fails, an archive is not what was written, says so to nobody, or can be read by our programs alone."""

from __future__ import annotations

import errno
import hashlib
import io
import json
import os
import tarfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import LocalFault
from scenefold.base.ids import SpaceId
from scenefold.base.location import Location
from scenefold.scene.archive import BATCH, Archive, ArchivedRecord, ArchivedScene, ArchivedSpace, NewArchive, position_after
from scenefold.scene.archive.layout import IndexLine, Totals
from scenefold.scene.log.space import Step
from scenefold.wire import PathSettings, RenderSettings

META = ArchivedSpace(SpaceId(1), "meta", 1, "hilbert", (0.0,), (1.0,), False, False, 3, 2, 1)
RENDERS = replace(META, id=SpaceId(9), name="renders", node_managed=True, render_output=True)
HALL = replace(
    META,
    id=SpaceId(31),
    name="hall é",
    dimensions=2,
    low=(-1.5, 0.1),
    high=(1e300, 0.30000000000000004),
    created=4,
    steps=(Step(5, 1.0, (0.1, -2.0)), Step(9, 1 / 3, (0.0, 0.0))),
)
PATHS = PathSettings(aperture=0.1, focus=3.0, adaptive=0.05, environment_rotation=-12.5)
SETTINGS = RenderSettings(1920, 1080, 256, None, (0.5, 1.0, 0.30000000000000004), -1.5, "door é", PATHS)
SCENE = ArchivedScene("kitchen", "0badcafe", "ab" * 32, 12, "edit", (META, RENDERS, HALL), SETTINGS)


def at(space: ArchivedSpace, number: int, payload: bytes, *, object_id: bytes = b"") -> ArchivedRecord:
    return ArchivedRecord(space.id, Location.from_number(number), object_id, 7, payload, 1_700_000_000)


RECORDS = [
    at(RENDERS, 5, b"a render", object_id=bytes(range(16))),
    at(RENDERS, 3, b"another", object_id=bytes(range(1, 17))),
    at(HALL, 0, b""),
    at(HALL, 1 << 159, bytes(range(256)) * 240),
    at(META, 0, b"the document"),
]


def parts_of(records: Sequence[ArchivedRecord]) -> list[list[ArchivedRecord]]:
    """As an export makes them: of one space each."""
    parts: list[list[ArchivedRecord]] = []
    for record in records:
        if parts and parts[-1][0].space == record.space and len(parts[-1]) < BATCH:
            parts[-1].append(record)
        else:
            parts.append([record])
    return parts


def written(folder: Path, records: Sequence[ArchivedRecord] = RECORDS, scene: ArchivedScene = SCENE) -> Path:
    place = folder / "kitchen.tar"
    place.unlink(missing_ok=True)
    archive = NewArchive(place)
    archive.begin(scene)
    for part in parts_of(records):
        archive.add(part)
    archive.finish()
    archive.abandon()
    return place


def read(place: Path) -> tuple[ArchivedScene, list[ArchivedRecord]]:
    archive = Archive(place)
    return archive.scene, [record for part in archive.batches() for record in part]


def untimed(records: Sequence[ArchivedRecord]) -> list[ArchivedRecord]:
    return [replace(record, seconds=0) for record in records]


def test_what_was_written_is_read(tmp_path: Path) -> None:
    place = written(tmp_path)
    assert read(place) == (SCENE, untimed(RECORDS))
    assert [path.name for path in tmp_path.iterdir()] == ["kitchen.tar"]
    assert place.stat().st_mode & 0o077 == 0, "nothing in it is encrypted"


@given(numbers=st.sets(st.integers(0, 2**160 - 1), max_size=600), content=st.binary(max_size=300))
def test_any_places_come_back(tmp_path_factory: pytest.TempPathFactory, numbers: set[int], content: bytes) -> None:
    records = [at(HALL, number, content + str(number).encode()) for number in sorted(numbers)]
    assert read(written(tmp_path_factory.mktemp("archive"), records))[1] == untimed(records)


def test_whoever_has_tar_and_json_can_read_it(tmp_path: Path) -> None:
    with tarfile.open(written(tmp_path), "r:") as tar:
        files = {told.name: tar.extractfile(told).read() for told in tar}  # type: ignore[union-attr]
        times = {told.mtime for told in tar if told.name.startswith("spaces/")}
    assert next(iter(files)) == "scene.json" and list(files)[-1] == "end.json"
    assert times == {1_700_000_000}
    index = [json.loads(line) for name in files if name.startswith("index/") for line in files[name].splitlines()]
    assert [files[line["file"]] for line in index] == [record.payload for record in RECORDS]
    assert all(hashlib.sha256(files[line["file"]]).hexdigest() == line["sha256"] for line in index)
    description = json.loads(files["scene.json"])
    hall, render = description["spaces"][-1], description["render"]
    assert render["sky"] == list(SETTINGS.sky or ()) and (render["width"], render["camera"]) == (1920, "door é") and "depth" not in render
    assert (hall["name"], hall["high"], hall["steps"][1]["factor"]) == (HALL.name, list(HALL.high), 1 / 3), "floats are the same numbers"


def test_an_archive_need_not_say_what_an_image_is_by_default(tmp_path: Path) -> None:
    assert read(forged(tmp_path, lambda files: untold(files, "render")))[0].render == RenderSettings()
    assert read(written(tmp_path, scene=replace(SCENE, render=RenderSettings())))[0].render == RenderSettings()


def test_the_space_that_shows_the_others_comes_last() -> None:
    assert [space.name for space in SCENE.order] == ["renders", HALL.name, "meta"]


@pytest.mark.parametrize(("position", "meant"), [(4, 40), (5, 50), (8, 50), (9, 90), (99, 90)])
def test_a_content_position_means_the_same_in_the_new_log(position: int, meant: int) -> None:
    assert position_after(position, HALL.steps, 40, [50, 90]) == meant


# ----------------------------------------------------------------------------------------------------- what is wrong


@given(st.data())
def test_one_changed_byte_is_noticed_or_changes_nothing(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    place = written(tmp_path_factory.mktemp("archive"))
    content = bytearray(place.read_bytes())
    content[data.draw(st.integers(0, len(content) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    place.write_bytes(content)
    try:
        found = read(place)
    except LocalFault:
        return
    assert found[1] == untimed(RECORDS), "its description is JSON, and bound by nothing"


@given(st.integers(0, 100_000))
def test_a_cut_archive_is_no_archive(tmp_path_factory: pytest.TempPathFactory, length: int) -> None:
    place = written(tmp_path_factory.mktemp("archive"))
    content = place.read_bytes()
    ends_at = content.rindex(b"index_sha256")
    place.write_bytes(content[: min(length, ends_at)])
    with pytest.raises(LocalFault):
        read(place)


@given(st.binary(max_size=3_000))
def test_anything_else_is_refused(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    place = tmp_path_factory.mktemp("archive") / "any.tar"
    place.write_bytes(content)
    with pytest.raises(LocalFault):
        read(place)


def forged(folder: Path, change: Callable[[list[tuple[tarfile.TarInfo, bytes]]], None]) -> Path:
    """An archive whose files somebody has changed."""
    with tarfile.open(written(folder), "r:") as tar:
        files = [(told, tar.extractfile(told).read()) for told in tar]  # type: ignore[union-attr]
    change(files)
    place = folder / "forged.tar"
    with tarfile.open(place, "w", format=tarfile.PAX_FORMAT) as tar:
        for told, content in files:
            told.size = len(content) if told.isreg() else 0
            tar.addfile(told, io.BytesIO(content))
    return place


Files = list[tuple[tarfile.TarInfo, bytes]]


def retold(files: Files, **changes: Any) -> None:
    files[0] = files[0][0], json.dumps(json.loads(files[0][1]) | changes).encode()


def untold(files: Files, key: str) -> None:
    document = json.loads(files[0][1])
    del document[key]
    files[0] = files[0][0], json.dumps(document).encode()


def renamed(files: Files, number: int, name: str) -> None:
    files[number][0].name = name


def linked(files: Files) -> None:
    files[2][0].type, files[2][0].linkname = tarfile.SYMTYPE, "/etc/passwd"


def told_again(files: Files) -> None:
    """The first part of the index, and its records, twice, with sums that say so."""
    first, *rest = files[1:-1]
    number = next(index for index, (told, _) in enumerate(rest) if told.name.startswith("index/"))
    again = tarfile.TarInfo("index/00000004.jsonl")
    files[-1:] = [(again, first[1]), *rest[:number], files[-1]]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda files: retold(files, version=2), "upgrade this program"),
        (lambda files: retold(files, format="picture"), "is not that of a scene"),
        (lambda files: retold(files, spaces=[]), "a space that the scene has not"),
        (lambda files: retold(files, spaces=[META.document(), META.document()]), "one number or name"),
        (lambda files: retold(files, spaces=[META.document() | {"low": [10**400]}]), "'low' of a space"),
        (lambda files: retold(files, spaces=[META.document() | {"low": [True]}]), "'low' of a space"),
        (lambda files: retold(files, render=[]), "'render' is no map"),
        (lambda files: retold(files, render={"width": 64}), "width and height both or neither"),
        (lambda files: retold(files, render={"samples": "many"}), "'render'.samples is not what it must be"),
        (lambda files: retold(files, render={"sky": [1, 10**400, 1]}), "'sky' of 'render'"),
        (lambda files: retold(files, render={"camera": "\ud800"}), "'render'.camera is not what it must be"),
        (lambda files: files.pop(0), "stands where scene.json belongs"),
        (lambda files: files.pop(), "cut off"),
        (lambda files: files.pop(2), "stands where spaces/9/"),
        (lambda files: files.append((tarfile.TarInfo("more"), b"")), "something follows"),
        (lambda files: renamed(files, 2, "../../etc/passwd"), "stands where spaces/9/"),
        (lambda files: renamed(files, 1, "index/00000002.jsonl"), "index/00000001.jsonl belongs"),
        (linked, "no plain file"),
        (told_again, "twice, or out of order"),
        (lambda files: files.__setitem__(2, (files[2][0], b"a remder")), "other bytes than were archived"),
        (lambda files: files.__setitem__(-1, (files[-1][0], Totals(4, 0, "").pack())), "does not say what stands before it"),
        (lambda files: files.__setitem__(1, (files[1][0], b"[]\n" * 2)), "is no map"),
        (lambda files: files.__setitem__(1, (files[1][0], b"[" * 100_000)), "is no JSON"),
        (lambda files: files.__setitem__(1, (files[1][0], b"")), "has 0 lines"),
    ],
)
def test_what_is_wrong_with_an_archive_is_said(tmp_path: Path, change: Callable[[Files], None], words: str) -> None:
    place = forged(tmp_path, change)
    with pytest.raises(LocalFault, match=words.replace(".", r"\.")) as fault:
        read(place)
    assert fault.value.where == str(place) and fault.value.remedy


def test_an_index_line_lets_no_other_file_in() -> None:
    record = RECORDS[2]
    line = IndexLine(record.space, record.location, b"", 0, hashlib.sha256(b"").digest(), 7)
    assert line.record(record.file, b"") == untimed([record])[0]


# ---------------------------------------------------------------------------------------------------------- writing


def test_nothing_is_written_over(tmp_path: Path) -> None:
    place = tmp_path / "there.tar"
    place.symlink_to(tmp_path / "nowhere")
    with pytest.raises(LocalFault, match="there is a file already"):
        NewArchive(place)
    place.unlink()
    archive = NewArchive(place)
    archive.begin(SCENE)
    place.write_text("somebody was quicker")
    with pytest.raises(LocalFault, match="there is a file already"):
        archive.finish()
    archive.abandon()
    assert place.read_text() == "somebody was quicker"
    assert [path.name for path in tmp_path.iterdir()] == ["there.tar"]


def test_one_process_at_a_time_writes_it_and_what_the_dead_left_is_begun_anew(tmp_path: Path) -> None:
    place = tmp_path / "kitchen.tar"
    (tmp_path / ".kitchen.tar.partial").write_bytes(b"x" * 100_000)
    first = NewArchive(place)
    with pytest.raises(LocalFault, match="another process writes this archive"):
        NewArchive(place)
    first.begin(SCENE)
    first.finish()
    assert read(place) == (SCENE, [])


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EIO])
@pytest.mark.parametrize("at_end", [False, True], ids=["in the midst", "at the end"])
def test_a_full_disk_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int, at_end: bool) -> None:
    place = tmp_path / "kitchen.tar"
    archive = NewArchive(place)
    archive.begin(SCENE)

    def full(*_arguments: Any) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, "fsync", full)
    if not at_end:
        monkeypatch.setattr(archive._tar, "addfile", full)
    with pytest.raises(LocalFault, match="cannot write the archive" if number == errno.EIO else "does not fit on the disk"):
        archive.finish() if at_end else archive.add(RECORDS[:1])
    archive.abandon()
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_not_there_is_said(tmp_path: Path) -> None:
    with pytest.raises(LocalFault, match="cannot write the archive: No such file"):
        NewArchive(tmp_path / "nowhere" / "kitchen.tar")
    with pytest.raises(LocalFault, match="cannot read the archive: No such file"):
        Archive(tmp_path / "kitchen.tar")
    with pytest.raises(LocalFault, match="cannot read the archive: Is a directory"):
        Archive(tmp_path)
