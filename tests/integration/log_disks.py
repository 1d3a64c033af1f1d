"""What the disks of nodes that run no more say of a scene's log."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from scenefold.scene.log import opened_value
from scenefold.simulation.log_agreement import Agreement, Entry
from scenefold.store import LmdbDisk
from scenefold.store.layout import LOGS, TABLES
from scenefold.store.log_rows import position_of, unpack_decided
from scenefold.wire import digest_of_header


def entries_on(folder: Path, genesis: bytes) -> Iterator[Entry]:
    """What a data folder has as decided, in order."""
    environment = LmdbDisk().open(folder, TABLES)
    try:
        with environment.read() as transaction:
            for key, stored in transaction.scan(LOGS, genesis, genesis + b"\xff" * 8):
                if position_of(key):
                    row = unpack_decided(key, stored)
                    header = opened_value(row.value).public
                    yield Entry(row.position, digest_of_header(header), header.request, header.previous)
    finally:
        environment.close()


def check_one_history(folders: Iterable[Path], genesis: bytes, acknowledged: Mapping[bytes, int]) -> int:
    """All of these have decided the same from position 2 on, without a gap, and what was acknowledged is in it once; gives the newest position."""
    agreement = Agreement()
    ends = set()
    for folder in folders:
        found = list(entries_on(folder, genesis))
        assert found, f"{folder} holds nothing of the log"
        assert [entry.position for entry in found] == list(range(2, found[-1].position + 1)), folder
        assert [wrong for entry in found for wrong in agreement.shown(folder.name, entry)] == []
        times = Counter(entry.request for entry in found)
        for request, position in acknowledged.items():
            assert (times[request], agreement.at[request]) == (1, position), (folder, request)
        ends.add(found[-1].position)
    assert len(ends) == 1, f"some lack what others have: {sorted(ends)}"
    return ends.pop()
