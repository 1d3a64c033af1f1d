"""Lists without what was deleted, and without the parts of split records (specs/18-data.md, Deleting and Splitting and merging).

Nodes cannot tell either from any other record, so whoever wants a list without them reads what is listed. A record that
cannot be read is listed: it may be alive.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from typing import TypeVar

from scenefold.client.access import SceneAccess
from scenefold.client.verifying import Key

BATCH = 256
"""Records read together: 16 MB of the largest."""

Listed = TypeVar("Listed")


async def alive(
    access: SceneAccess, listed: AsyncIterator[Listed], key_of: Callable[[Listed], Key], *, stale_ok: bool = False
) -> AsyncIterator[Listed]:
    """What is listed, in its order, without what was deleted or is a part of something else."""
    batch: list[Listed] = []
    async for item in listed:
        batch.append(item)
        if len(batch) == BATCH:
            for living in await _living(access, batch, key_of, stale_ok):
                yield living
            batch = []
    for living in await _living(access, batch, key_of, stale_ok):
        yield living


async def _living(access: SceneAccess, batch: list[Listed], key_of: Callable[[Listed], Key], stale_ok: bool) -> list[Listed]:
    if not batch:
        return []
    gone = await access.unlisted([key_of(item) for item in batch], stale_ok=stale_ok)
    return [item for item, is_gone in zip(batch, gone, strict=True) if not is_gone]
