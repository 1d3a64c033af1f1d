"""Whether records of a scene still lie under former keys, for whoever asks after a revocation (specs/16-scene-log.md, Members).

The answer is looked up in the records themselves, so no note of it can be lost, or be wrong. A re-encryption that was ended left what
comes last in its walk: looked at is from the end, so that it is found soon, and only for a short while, since somebody waits.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import aclosing
from enum import Enum

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import SpaceId
from scenefold.base.limits import CLIENT_GET_KEYS
from scenefold.base.location import Arc, arcs_between, even_right_bounds
from scenefold.client.access import SceneAccess
from scenefold.client.ranging import entries
from scenefold.client.reencryption import under_older_keys
from scenefold.client.sealing import Key

LOOK_S = 3.0
PIECES = 8
"""Each space is listed in so many: what lies in the last is seen before the others are listed."""


class FormerKeys(Enum):
    """What was found of records under keys of former epochs."""

    NONE = "none"
    """All records were looked at."""
    SOME = "some"
    UNKNOWN = "unknown"
    """None among those that were looked at: there are too many, or a node did not answer."""


async def former_keys(access: SceneAccess) -> FormerKeys:
    """Takes LOOK_S at most, beyond reading the log; nothing at all for a scene whose key never changed."""
    state = (await access.read_log()).state
    spaces = [space.id for space in state.spaces.values() if not space.parent]
    found = FormerKeys.UNKNOWN
    with trio.move_on_after(LOOK_S):
        try:
            found = await _looked(access, spaces, state.grants.key_epoch)
        except (Unreachable, Refused, PeerFault):
            return FormerKeys.UNKNOWN
    return found


async def _looked(access: SceneAccess, spaces: Sequence[SpaceId], epoch: int) -> FormerKeys:
    for space, piece in _from_the_end(spaces) if epoch else ():
        batch: list[Key] = []
        async with aclosing(entries(access.calls, access.identity.scene, space, piece.first, piece.last, stale_ok=False)) as listed:
            async for location, object_id in listed:
                batch.append((space, location, object_id) if object_id else (space, location))
                if len(batch) == CLIENT_GET_KEYS:
                    if under_older_keys(await access.fetch(batch), epoch):
                        return FormerKeys.SOME
                    batch = []
        if batch and under_older_keys(await access.fetch(batch), epoch):
            return FormerKeys.SOME
    return FormerKeys.NONE


def _from_the_end(spaces: Sequence[SpaceId]) -> Iterator[tuple[SpaceId, Arc]]:
    pieces = arcs_between(even_right_bounds(PIECES))
    return ((space, piece) for space in reversed(spaces) for piece in reversed(pieces))
