"""What a long log of a scene costs its readers and authors, whole and with a snapshot (specs/16-scene-log.md, Snapshots).

    .venv/bin/python tools/measure_scene_log.py 10000

Bytes, and seconds of processor time, the least of three: to open a log for the first time, to open it with one record more than were read, to
compare a snapshot with records that were read, and to make it.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

from scenefold.base.ids import NodeId, SpaceId
from scenefold.base.location import FIRST
from scenefold.crypto import SealingKey, SigningKey
from scenefold.scene.log import OpenedLog, SceneLog, first_record, open_private, seal_private, shortened, sign_record
from scenefold.wire import (
    CreateSpace,
    CurveKind,
    Grant,
    KeyEntry,
    LogEntry,
    LogRecord,
    Role,
    ScaleSpace,
    SceneMode,
    SetMode,
    TranslateSpace,
)

GENESIS, ORIGIN, KEY = bytes(range(32)), NodeId(7), bytes(24)
HEADER_KEY = SigningKey(bytes(32))
SPACES = 16


def moves(count: int) -> Iterator[LogEntry]:
    """Of so many spaces in three dimensions, in turns; every tenth a scale, there and back."""
    spaces = [SpaceId(100 + index) for index in range(SPACES)]
    for space in spaces:
        yield CreateSpace(space, 3, CurveKind.HILBERT, False, SpaceId(0), FIRST, 1, 1, False, f"space {space}", (0.0,) * 3, (8.0,) * 3)
    for index in range(count - SPACES):
        space = spaces[index % SPACES]
        if index % 10 == 9:
            yield ScaleSpace(space, 1.1 if index % 20 == 9 else 1 / 1.1)
        else:
            yield TranslateSpace(space, (0.1 * (index % 7), -0.2, 0.3))


def modes(count: int) -> Iterator[LogEntry]:
    """What leaves nothing behind but its request id."""
    return (SetMode(SceneMode(index % 2)) for index in range(count))


def records_of(entries: Iterator[LogEntry]) -> list[LogRecord]:
    """A log with these entries."""
    signing, sealing = SigningKey(b"m" * 32).public, SealingKey(b"s" * 32).public
    maker = Grant("user:ada", Role.OWNER, KeyEntry(1, signing.raw), KeyEntry(1, sealing.raw))
    records = [first_record(GENESIS, ORIGIN, maker)]
    for index, entry in enumerate(entries):
        before = records[-1]
        records.append(LogRecord(before.position + 1, before.hash(), index.to_bytes(16, "big"), ORIGIN, entry))
    return records


def least(work: Callable[[], Any]) -> tuple[float, Any]:
    """Seconds of processor time, and what came out."""
    spent, found = [], None
    for _ in range(3):
        begin = time.process_time()
        found = work()
        spent.append(time.process_time() - begin)
    return min(spent), found


def sealed(log: OpenedLog) -> bytes:
    return seal_private(log.records, genesis=GENESIS, symmetric_key=KEY, key_epoch=0, nonce=bytes(12), snapshot=log.snapshot)


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000
    for name, entries in (("moves", moves(count)), ("changes of mode", modes(count))):
        records = records_of(entries)
        log = OpenedLog(SceneLog.of(records), tuple(sign_record(record, HEADER_KEY) for record in records))
        read = OpenedLog(SceneLog.of(records[:-1]), log.records[:-1])
        making, short = least(partial(shortened, log, GENESIS, HEADER_KEY))
        print(f"{count:,} {name}; to make the snapshot {making:.2f} s")
        behind = replace(short, state=read.state, records=short.records[:-1])
        for what, one, known in (("whole", log, read), ("with a snapshot", short, behind)):
            private = sealed(one)
            told: dict[str, Any] = {"genesis": GENESIS, "position": len(records), "symmetric_key": KEY, "header_key": HEADER_KEY.public}
            opening, one_more, compared = (least(partial(open_private, private, known=before, **told))[0] for before in (None, known, read))
            print(f"  {what}: {len(private):,} bytes, opened {opening:.3f} s, one more {one_more:.4f} s, known by records {compared:.3f} s")


if __name__ == "__main__":
    main()
