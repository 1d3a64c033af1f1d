"""If this failed, the folder of a node that was killed could not be looked at, would be called damaged, or would not be mended."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from integration.living_clusters import living_cluster
from scenefold.base.errors import LocalFault
from scenefold.peer.checking import check_folder, mend_folder
from scenefold.store import LmdbDisk
from scenefold.store.layout import DIGESTS, OBJECTS, STATISTICS, TABLES
from scenefold.world import WriteTransaction


def rot(folder: Path, dice: random.Random) -> int:
    """Turn a bit over in a value of each table that follows from something else; in how many."""

    def change(transaction: WriteTransaction) -> int:
        hits = 0
        for table in (STATISTICS, DIGESTS, OBJECTS):
            for key in list(transaction.keys(table, b"", b"\xff" * 64))[:1]:
                value = bytearray(transaction.get(table, key) or b"")
                value[dice.randrange(len(value))] ^= 1 << dice.randrange(8)
                transaction.put(table, key, bytes(value))
                hits += 1
        return hits

    environment = LmdbDisk().open(folder, TABLES)
    try:
        return environment.update(change)
    finally:
        environment.close()


async def test_folders_of_nodes_that_were_killed_are_sound_and_what_rots_in_them_is_mended(tmp_path: Path) -> None:
    async with living_cluster(tmp_path, 3) as living:
        kept, nodes = living.kept, living.nodes
        await kept.put_evenly(300, 3_000)
        await kept.put_evenly(40, 50_000)
        folders = [nodes.folder / "data" / address for address in nodes.addresses]
        for address, folder in zip(nodes.addresses, folders, strict=True):
            with pytest.raises(LocalFault, match=f"in use by process {nodes.pid(address)}"):
                check_folder(folder)
        for address in nodes.addresses:
            await nodes.kill(address)
        records = 0
        for folder in folders:
            checked = check_folder(folder)
            assert checked.findings.listed == []
            # The keeper of the scene's log has its header, and so has everybody else.
            assert checked.findings.signatures == checked.findings.records.records
            records += checked.findings.records.records
            assert rot(folder, random.Random(1)) >= 2
            repaired = mend_folder(folder)
            assert repaired.done and repaired.after.findings.is_sound
        assert records >= len(kept.records)
        for address in nodes.addresses:
            nodes.start(address)
        await nodes.wait()
        await kept.check()
