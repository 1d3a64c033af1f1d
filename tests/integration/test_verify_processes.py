"""If this failed, the folder of a node that was killed could not be looked at, would be called damaged, or would not be mended.

Or what cannot be mended in it would not be fetched from copies once the node runs.
"""

from __future__ import annotations

import random
from pathlib import Path

import pytest
import trio

from integration.living_clusters import Kept, living_cluster
from integration.test_copies_processes import whole
from scenefold.base.errors import LocalFault
from scenefold.base.ids import SpaceId
from scenefold.client import Cluster
from scenefold.client.reports import NodeReport
from scenefold.peer.checking import check_folder, mend_folder
from scenefold.store import LmdbDisk
from scenefold.store.checking import Helps
from scenefold.store.layout import DIGESTS, OBJECTS, RECORDS, STATISTICS, TABLES, space_of
from scenefold.world import WriteTransaction

TESTS = Path(__file__).parent.parent
COPIED = 30
LOOK_S = 0.5
PATIENCE_S = 60.0


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


def spoil(folder: Path, space: SpaceId) -> None:
    """Of the records of a space one has rotted, and in the place of another one lies what belongs elsewhere."""

    def change(transaction: WriteTransaction) -> None:
        keys = [key for key in transaction.keys(RECORDS, b"", b"\xff" * 64) if space_of(key)[1] == space]
        rotten, strange, other = keys[0], keys[len(keys) // 2], keys[-1]
        value = bytearray(transaction.get(RECORDS, rotten) or b"")
        value[-1] ^= 1
        transaction.put(RECORDS, rotten, bytes(value))
        transaction.put(RECORDS, strange, bytes(transaction.get(RECORDS, other) or b""))

    environment = LmdbDisk().open(folder, TABLES)
    try:
        environment.update(change)
    finally:
        environment.close()


async def is_healed(cluster: Cluster, address: str, rotten: int) -> bool:
    """Whether a node has met so many rotten records since its start, and has them again, by its own word."""
    report = (await cluster.reports([address]))[address]
    return isinstance(report, NodeReport) and report.damaged == rotten and report.copies is not None and not report.copies.rotten


async def test_folders_of_nodes_that_were_killed_are_sound_and_what_rots_in_them_is_mended_or_fetched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(TESTS))
    async with living_cluster(tmp_path, 3, module="integration.scrubbing_node") as living:
        kept, nodes = living.kept, living.nodes
        scene = await living.cluster.scenes.open("kept")
        copied = Kept(await scene.create_space("copied", dimensions=1, copies=3))
        await copied.put_evenly(COPIED, 3_000)
        await kept.put_evenly(300, 3_000)
        await kept.put_evenly(40, 50_000)
        await whole(living, 3, PATIENCE_S)
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
        assert records >= len(kept.records) + 3 * COPIED
        # It is where the one lies as a copy, and the other one by its own right.
        victim, folder = nodes.addresses[1], folders[1]
        spoil(folder, copied.space.id)
        repaired = mend_folder(folder)
        assert RECORDS in {finding.table for finding in repaired.done}, "what belongs elsewhere lies there no more"
        assert repaired.after.findings.counts == {Helps.FETCH: 2} and len(repaired.after.findings.rotten) == 2
        for address in nodes.addresses:
            nodes.start(address)
        await nodes.wait()
        with trio.fail_after(PATIENCE_S):
            # Nobody else asks for them, and nobody tells when they are there.
            while not await is_healed(living.cluster, victim, 2):  # noqa: ASYNC110
                await trio.sleep(LOOK_S)
        await kept.check()
        await copied.check()
        await nodes.kill(victim)
        assert check_folder(folder).findings.listed == []
