"""Trees of digests that lack records are built bit by bit, beside all else that is written (specs/10-store.md, Digests)."""

from __future__ import annotations

import logging

import trio

from scenefold.base.errors import Refused
from scenefold.store.changes import BuildDigests
from scenefold.store.writer import GroupWriter

STEP_RECORDS = 2_048
"""Of one commit: some 30 ms, while others wait."""
AGAIN_S = 60.0
"""The disk is full: meanwhile sums are counted."""

_log = logging.getLogger("scenefold.store")


async def keep_building(writer: GroupWriter) -> None:
    """Build whenever the writer says that there is something to be built."""
    while True:
        await writer.unbuilt.wait()
        writer.unbuilt = trio.Event()
        try:
            await writer.submit(BuildDigests(STEP_RECORDS))
        except Refused as refusal:
            _log.info("the digests of the records are built later: %s", refusal)
            await trio.sleep(AGAIN_S)
            writer.unbuilt.set()
            continue
        if not writer.unbuilt.is_set():
            _log.info("the digests of all records are built")
