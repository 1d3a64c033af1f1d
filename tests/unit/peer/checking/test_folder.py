"""If this failed, a node's folder would be called sound on which it does not start, or wiped for what others have."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

from scenefold.base.errors import DamagedData, LocalFault
from scenefold.crypto import Record, RecordPlace, SigningKey
from scenefold.peer.checking import Checked, check_folder, mend_folder
from scenefold.peer.scrub.note import NOTE, decode_round
from scenefold.store import LmdbDisk, Spot, open_store
from scenefold.store.checking import Helps
from scenefold.store.folder import LOCK_NAME
from scenefold.store.layout import HEADERS, HOLDING, IDENTITY, NOTES, RECORDS, STATISTICS, TABLES, pack_record, scene_key
from scenefold.store.sealing import sealed
from unit.peer.checking.folders_made import COUNT, SCENE, at, changed, filled, key, on_the_disk, rot, signed
from unit.peer.scenes_made import SPACE, later_header
from unit.store.samples import NODE, world

LOG_NOTE = b"scene-log/%08x" % SCENE.scene


def told(checked: Checked) -> list[tuple[str, str]]:
    return [(finding.table, str(finding.helps)) for finding in checked.findings.listed]


def hashes(folder: Path) -> dict[str, str]:
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.iterdir() if path.name != LOCK_NAME}


async def test_a_folder_in_which_all_is_well(tmp_path: Path) -> None:
    await filled(tmp_path)
    before, progress = hashes(tmp_path), list[tuple[str, int, int | None]]()
    checked = check_folder(tmp_path, tell=lambda *step: progress.append(step))
    assert told(checked) == [] and checked.identity is not None and checked.identity.node == NODE
    assert checked.findings.records.records == checked.findings.signatures == COUNT
    assert progress[0] == ("records", 0, COUNT) and ("records", COUNT, COUNT) in progress
    assert check_folder(tmp_path, signatures=False).findings.signatures == 0
    assert mend_folder(tmp_path).done == []
    assert hashes(tmp_path) == before


async def test_a_record_that_its_writer_did_not_sign_is_found_and_becomes_a_wreck(tmp_path: Path) -> None:
    await filled(tmp_path)
    record = signed(7)
    forged = Record(record.header_bytes, SigningKey.from_seed(b"x" * 32).sign(b"domain", b"bytes"), record.ciphertext)
    changed(tmp_path, RECORDS, key(7), pack_record(forged))
    assert check_folder(tmp_path, signatures=False).findings.is_sound
    checked = check_folder(tmp_path)
    assert told(checked) == [(RECORDS, "fetch")] and "signed" in checked.findings.listed[0].what
    repaired = mend_folder(tmp_path)
    assert [finding.table for finding in repaired.done] == [RECORDS]
    assert told(repaired.after) == [(RECORDS, "fetch")]


@pytest.mark.expect_log("changed on the disk")
async def test_word_of_what_has_rotted_is_left_to_the_node(tmp_path: Path) -> None:
    await filled(tmp_path)
    rot(tmp_path, RECORDS, key(7), 300)
    rot(tmp_path, RECORDS, key(9), 10)
    rot(tmp_path, STATISTICS, key(0)[:6])
    assert told(check_folder(tmp_path)) == [(RECORDS, "fetch"), (RECORDS, "fetch"), (STATISTICS, "mend")]
    dry = mend_folder(tmp_path, dry_run=True)
    assert [finding.table for finding in dry.done] == [STATISTICS] and len(told(dry.after)) == 3
    repaired = mend_folder(tmp_path)
    assert [finding.table for finding in repaired.done] == [STATISTICS] and told(repaired.after) == [(RECORDS, "fetch")] * 2
    async with open_store(world(), tmp_path, NODE) as store:
        note = await store.get_note(NOTE)
        assert note is not None and decode_round(note).told == (key(7), key(9))
        answers = await store.read([Spot(RecordPlace(SCENE.scene, SPACE, at(number))) for number in (7, 8, 9)])
        assert [isinstance(answer, DamagedData) for answer in answers] == [True, False, True]


async def test_what_cannot_be_mended_leaves_all_as_it_is(tmp_path: Path) -> None:
    await filled(tmp_path)
    rot(tmp_path, HOLDING, b"note", 5)
    rot(tmp_path, STATISTICS, key(0)[:6])
    rot(tmp_path, RECORDS, key(7), 300)
    before = hashes(tmp_path)
    repaired = mend_folder(tmp_path)
    assert repaired.done == [] and repaired.after.findings.counts[Helps.WIPE] == 1
    assert hashes(tmp_path) == before


# -------------------------------------------------------------------------------------------------------------- headers


async def forget_log(folder: Path) -> None:
    with on_the_disk(folder) as environment:
        environment.update(lambda transaction: transaction.delete(NOTES, LOG_NOTE))


@pytest.mark.parametrize("is_kept", [True, False], ids=["log kept here", "log kept elsewhere"])
async def test_a_damaged_header_is_asked_for_unless_the_scenes_log_is_kept_here(tmp_path: Path, is_kept: bool) -> None:
    await filled(tmp_path)
    if not is_kept:
        await forget_log(tmp_path)
    rot(tmp_path, HEADERS, scene_key(SCENE.scene), 50)
    checked = check_folder(tmp_path)
    assert told(checked) == [(HEADERS, "wipe" if is_kept else "fetch")]
    assert checked.findings.signatures == 0, "nobody knows the scene's writers"


async def test_a_header_under_anothers_key(tmp_path: Path) -> None:
    await filled(tmp_path)
    changed(tmp_path, HEADERS, b"\0\0\0\1", SCENE.encode())
    changed(tmp_path, HEADERS, b"??", SCENE.encode())
    assert told(check_folder(tmp_path)) == [(HEADERS, "fetch")] * 2


async def test_a_record_of_which_a_later_header_says_something_else_is_left_alone(tmp_path: Path) -> None:
    """Its epoch has not come, its writer is gone: no node would take it now, and one has taken it."""
    await filled(tmp_path)
    changed(tmp_path, HEADERS, scene_key(SCENE.scene), later_header(SCENE, writers=()).encode())
    checked = check_folder(tmp_path)
    assert told(checked) == [] and checked.findings.signatures == 0


# ---------------------------------------------------------------------------------------------------------------- notes


@pytest.mark.parametrize(
    ("table", "name", "helps"),
    [
        (HOLDING, "note", "wipe"),
        (HOLDING, "copies", "wipe"),
        (NOTES, "cluster-log/00000000", "wipe"),
        (NOTES, "cluster-log/header", "wipe"),
        (NOTES, "cluster-log/lives", "wipe"),
        (NOTES, "cluster-log/life/7f000002", "wipe"),
        (NOTES, "cluster-log/held/7f", "wipe"),
        (NOTES, "cluster-log/ready", "wipe"),
        (NOTES, "blacklist", "wipe"),
        (NOTES, NOTE, "mend"),
        (NOTES, "upkeep", "mend"),
    ],
)
async def test_a_note_that_cannot_be_read_is_found_though_its_bytes_are_those_that_were_written(
    tmp_path: Path, table: str, name: str, helps: str
) -> None:
    await filled(tmp_path)
    changed(tmp_path, table, name.encode(), sealed(table, name.encode(), b"what is this"))
    assert told(check_folder(tmp_path)) == [(table, helps)]
    assert (told(mend_folder(tmp_path).after) == []) == (helps == "mend")


async def test_a_note_of_the_arc_that_speaks_of_another_arc(tmp_path: Path) -> None:
    await filled(tmp_path)
    changed(tmp_path, HOLDING, b"arc", sealed(HOLDING, b"arc", bytes(20) + b"\x7f" * 20))
    assert told(check_folder(tmp_path)) == [(HOLDING, "wipe")]


async def test_a_note_of_a_name_that_nobody_knows_is_left_alone(tmp_path: Path) -> None:
    await filled(tmp_path)
    changed(tmp_path, NOTES, b"of a later version", sealed(NOTES, b"of a later version", b"what is this"))
    assert told(check_folder(tmp_path)) == []


# -------------------------------------------------------------------------------------------------------------- refused


async def test_a_folder_in_use_and_one_of_another_format_are_neither_looked_at_nor_mended(tmp_path: Path) -> None:
    await filled(tmp_path)
    for look in (check_folder, mend_folder):
        environment = LmdbDisk().open(tmp_path, TABLES)
        with pytest.raises(LocalFault, match="in use by process"):
            look(tmp_path)
        environment.close()
    changed(tmp_path, IDENTITY, b"format", sealed(IDENTITY, b"format", b"\0\0\0\x63"))
    for look in (check_folder, mend_folder):
        with pytest.raises(LocalFault, match="newer scenefold"):
            look(tmp_path)
    for look in (check_folder, mend_folder):
        with pytest.raises(LocalFault, match="no store"):
            look(tmp_path / "nothing")
    assert not (tmp_path / "nothing").exists()
