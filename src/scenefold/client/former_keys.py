"""Whether records of a scene still lie under former keys, for whoever asks after a revocation (specs/16-scene-log.md, Members).

The answer is looked up in the records themselves, so no note of it can be lost, or be wrong. A re-encryption that was ended left what
comes last in its walk: looked at is from the end, so that it is found soon, and only for a short while, since somebody waits. Most spaces
hold little: each is listed whole, several at once, and in pieces only where that is a long list.
"""

from __future__ import annotations

from collections.abc import AsyncGenerator, Iterable, Iterator, Sequence
from contextlib import aclosing
from enum import Enum

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import SpaceId
from scenefold.base.limits import CLIENT_GET_KEYS
from scenefold.base.location import FIRST, LAST, Arc, arcs_between, even_right_bounds
from scenefold.client.access import SceneAccess
from scenefold.client.ranging import entries
from scenefold.client.reencryption import under_older_keys
from scenefold.client.verifying import Key

LOOK_S = 3.0
SPACES_AT_ONCE = 4
"""A few, for each may be reading records of megabytes."""
LONG = 16 * CLIENT_GET_KEYS
"""A space with more records than that is listed in pieces."""
PIECES = 8
"""So many: what lies in the last is seen before the others are listed."""
_WHOLE = Arc(FIRST, LAST)


class FormerKeys(Enum):
    """What was found of records under keys of former epochs."""

    NONE = "none"
    """All records were looked at."""
    SOME = "some"
    UNKNOWN = "unknown"
    """None among those that were looked at: there are too many, or a node did not answer."""


async def former_keys(access: SceneAccess, look_s: float = LOOK_S) -> FormerKeys:
    """Takes `look_s` at most, beyond reading the log; nothing at all for a scene whose key never changed."""
    state = (await access.read_log()).state
    spaces = [space.id for space in state.spaces.values() if not space.parent]
    if not state.grants.key_epoch:
        return FormerKeys.NONE
    look = _Look(access, state.grants.key_epoch, spaces)
    with trio.move_on_after(look_s):
        await look.run()
    return look.found


class _Look:
    def __init__(self, access: SceneAccess, epoch: int, spaces: Sequence[SpaceId]) -> None:
        self._access = access
        self._epoch = epoch
        self._to_begin = iter(reversed(spaces))
        self._left = set(spaces)
        self._has_found = False

    @property
    def found(self) -> FormerKeys:
        """So far."""
        if self._has_found:
            return FormerKeys.SOME
        return FormerKeys.UNKNOWN if self._left else FormerKeys.NONE

    async def run(self) -> None:
        """Until something is found, or all was looked at that could be."""
        async with trio.open_nursery() as nursery:
            for _ in range(SPACES_AT_ONCE):
                nursery.start_soon(self._work, nursery.cancel_scope)

    async def _work(self, scope: trio.CancelScope) -> None:
        for space in self._to_begin:
            try:
                self._has_found |= await self._is_left_in(space)
            except (Unreachable, Refused, PeerFault):
                # Who does not answer for one space hides nothing in the others.
                continue
            self._left.discard(space)
            if self._has_found:
                scope.cancel()

    async def _is_left_in(self, space: SpaceId) -> bool:
        """Whether anything in a space lies under an older key."""
        listed: list[Key] = []
        async with aclosing(self._keys(space, _WHOLE)) as keys:
            async for key in keys:
                listed.append(key)
                if len(listed) > LONG:
                    break
            else:
                return await self._is_any_older(_from_the_end(listed))
        for piece in reversed(arcs_between(even_right_bounds(PIECES))):
            batch: list[Key] = []
            async with aclosing(self._keys(space, piece)) as keys:
                async for key in keys:
                    batch.append(key)
                    if len(batch) == CLIENT_GET_KEYS:
                        if await self._is_any_older([batch]):
                            return True
                        batch = []
            if batch and await self._is_any_older([batch]):
                return True
        return False

    async def _keys(self, space: SpaceId, piece: Arc) -> AsyncGenerator[Key, None]:
        access = self._access
        async with aclosing(entries(access.calls, access.identity.scene, space, piece.first, piece.last, stale_ok=False)) as listed:
            async for location, object_id in listed:
                yield (space, location, object_id) if object_id else (space, location)

    async def _is_any_older(self, batches: Iterable[Sequence[Key]]) -> bool:
        for batch in batches:
            if under_older_keys(await self._access.fetch(batch), self._epoch):
                return True
        return False


def _from_the_end(keys: Sequence[Key]) -> Iterator[Sequence[Key]]:
    return (keys[max(0, end - CLIENT_GET_KEYS) : end] for end in range(len(keys), 0, -CLIENT_GET_KEYS))
