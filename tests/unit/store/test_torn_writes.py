"""If this failed, a power cut in the middle of a commit would take more with it than that commit.

A commit writes its pages, in any order and each in any parts; once the disk has them it writes one meta page. So a cut leaves the file of
before with some of the sectors of after, wherever they are but in that page.
"""

from __future__ import annotations

import random
import shutil
from pathlib import Path

import pytest

from scenefold.base.location import WHOLE_LINE
from scenefold.crypto import Record
from scenefold.store import Put, Store, open_store
from scenefold.store.checking import check_store
from scenefold.store.layout import TABLES
from scenefold.store.lmdb_disk import DATA_NAME
from scenefold.store.lmdb_reading import looked_at
from unit.store.samples import NODE, managed, record, whole_store, world

SECTOR = 512
META_BYTES = 2 * 4096


async def change(store: Store, step: int, dice: random.Random) -> None:
    """Puts, objects, debts and deletions, large ones and small ones, in one commit."""
    puts = [Put(record(dice.randrange(60) << 150, seq=step, size=dice.choice([40, 6_000, 60_000]))) for _ in range(dice.choice([1, 12]))]
    if step % 3 == 0:
        puts += [Put(managed(dice.randrange(30), seq=step))]
    if step % 4 == 3:
        page = await store.manifest(WHOLE_LINE, None, 1_000)
        await store.remove([(entry.spot, entry.digest) for entry in dice.sample(page.entries, min(5, len(page.entries)))])
    else:
        await store.put(
            list({put.record.header.location: put for put in puts}.values()), [(NODE,)] * len({put.record.header.location for put in puts})
        )


async def contents(folder: Path) -> list[Record | None]:
    async with open_store(world(), folder, NODE) as store:
        page = await store.manifest(WHOLE_LINE, None, 1_000)
        found = await store.read([entry.spot for entry in page.entries])
        assert all(isinstance(one, Record) for one in found)
        return [one for one in found if isinstance(one, Record)]


def torn(before: bytes, after: bytes, dice: random.Random) -> bytes:
    """Some sectors of what came after, but no meta page."""
    data = bytearray(before.ljust(dice.choice([len(before), max(len(before), len(after))]), b"\0"))
    share = dice.choice([0.1, 0.5, 1.0])
    for at in range(META_BYTES, min(len(data), len(after)), SECTOR):
        if dice.random() < share:
            data[at : at + SECTOR] = after[at : at + SECTOR]
    return bytes(data)


@pytest.mark.parametrize("seed", range(6))
async def test_of_a_commit_that_is_cut_short_nothing_is_there_and_all_before(tmp_path: Path, seed: int) -> None:
    dice, folder, cut = random.Random(seed), tmp_path / "whole", tmp_path / "cut"
    async with whole_store(world(), folder):
        pass
    for step in range(1, 9):
        before = (folder / DATA_NAME).read_bytes()
        async with open_store(world(), folder, NODE) as store:
            # The start is a commit of its own.
            begun = (folder / DATA_NAME).read_bytes()
            await change(store, step, dice)
            commits = store.commits
        after = (folder / DATA_NAME).read_bytes()
        assert commits == 1 and before[:META_BYTES] != begun[:META_BYTES] != after[:META_BYTES]
        kept = {}
        for name, data in (("before", begun), ("torn", torn(begun, after, dice))):
            shutil.rmtree(cut, ignore_errors=True)
            cut.mkdir()
            (cut / DATA_NAME).write_bytes(data)
            with looked_at(cut, TABLES) as view:
                assert check_store(view).is_sound
            kept[name] = await contents(cut)
        assert kept["torn"] == kept["before"]
