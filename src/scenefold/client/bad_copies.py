"""What holders of copies have otherwise than it counts: their owner is told, and compares it (specs/20-copies.md, What readers meet)."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, SceneId
from scenefold.base.limits import CLIENT_STATUS_S, COPIES_TOLD_MAX
from scenefold.client.calls import Calls
from scenefold.client.verifying import Key
from scenefold.wire import CopiesLookedAt, LookAtCopies, RecordKey

AGAIN_S = 1.0
"""Owners are told so often of one node: where one has lost much, each answer says so."""
TELL_S = 0.1
"""Nobody waits longer for the answer, of which nothing depends."""


class BadCopies:
    """What was met in one call."""

    def __init__(self) -> None:
        self._met: dict[tuple[NodeId, NodeId], dict[int, None]] = {}

    def met(self, owner: NodeId, holder: NodeId, index: int) -> None:
        """A holder has something else of a record, by its number, than counts, or nothing."""
        self._met.setdefault((owner, holder), {})[index] = None

    async def tell(self, calls: Calls, scene: SceneId, keys: Sequence[Key]) -> None:
        """Tell the owners, those that answer."""
        now = calls.world.clock.now()
        for (owner, holder), indices in self._met.items():
            if calls.is_silent(owner) or now - calls.told_at.get(holder, -AGAIN_S) < AGAIN_S:
                continue
            calls.told_at[holder] = now
            packet = LookAtCopies(scene, holder, tuple(RecordKey(*keys[index]) for index in list(indices)[:COPIES_TOLD_MAX]))
            with suppress(Unreachable, Refused, PeerFault), trio.move_on_after(TELL_S):
                await calls.ask(calls.address_of(owner), packet, CopiesLookedAt, timeout_s=CLIENT_STATUS_S)
        self._met.clear()
