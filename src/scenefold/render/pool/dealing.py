"""How many paths of a pass each node gets, where every node holds the whole scene (specs/33-dealt-paths.md). Pure; time comes in as seconds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scenefold.render.arrays import U32
from scenefold.render.ledger import Counts

PROBE_RAYS = 64
"""At least so many get those who have nothing else to do: else nobody would ever learn that they are quick again."""
_GAIN = 0.5
"""Of a new measurement. One that says that a node is slower than it was counts less if it is of fewer rays than `_SOUND_RAYS`:
what it took is mostly the way there and back."""
_SOUND_RAYS = 8_192
_PATIENCE_S = 0.25
"""Later than expected, before a part says that its node is slower."""
_COPIED_RAYS = 4_096
"""So few do not keep all of their pass in memory while they wait."""


@dataclass(frozen=True, slots=True)
class _Part:
    """Of one pass, at one node."""

    rays: int
    dealt_at: float


class Dealer:
    """Of one owner's passes, among so many nodes."""

    def __init__(self, nodes: int) -> None:
        self._paces: list[float | None] = [None] * nodes
        """Rays a second, once something was measured."""
        self._parts: list[dict[int, _Part]] = [{} for _ in range(nodes)]
        """Of each node by pass: what it has not done."""

    def deal(self, number: int, rays: int, now: float) -> list[int]:
        """How many of a pass's rays each node gets."""
        shares = np.array(self._estimates(now))
        exact = rays * shares / shares.sum()
        dealt = np.floor(exact).astype(np.int64)
        for node in np.argsort(dealt - exact, kind="stable")[: rays - int(dealt.sum())]:
            dealt[node] += 1
        for node, parts in enumerate(self._parts):
            missing = 0 if parts else max(0, PROBE_RAYS - int(dealt[node]))
            most = int(np.argmax(dealt))
            if missing and dealt[most] >= 4 * PROBE_RAYS:
                dealt[node] += missing
                dealt[most] -= missing
        for node, count in enumerate(dealt.tolist()):
            if count:
                self._parts[node][number] = _Part(count, now)
        return [int(count) for count in dealt]

    def dealt(self, number: int, rays: U32, now: float) -> dict[int, U32]:
        """A pass's camera rays, by the node that gets them: ranges, one after the other."""
        found, first = {}, 0
        for node, count in enumerate(self.deal(number, len(rays), now)):
            if count:
                part = rays[first : first + count]
                found[node] = part.copy() if count < _COPIED_RAYS else part
                first += count
        return found

    def reported(self, number: int, node: int, counts: Counts, now: float, *, is_owner: bool = False) -> None:
        """A node's counts of a pass: its part may be done. The owner's own rays are among those that it created."""
        part = self._parts[node].get(number)
        if part is None:
            return
        if is_owner:
            is_done = counts.retired >= part.rays and counts.created + counts.received == counts.retired + counts.sent
        else:
            is_done = counts.received >= part.rays and counts.created + counts.received == counts.retired
        if not is_done:
            return
        del self._parts[node][number]
        pace, measured = self._paces[node], part.rays / max(now - part.dealt_at, 1e-3)
        if pace is None:
            self._paces[node] = measured
            return
        weight = 1.0 if measured > pace else min(1.0, part.rays / _SOUND_RAYS)
        self._paces[node] = pace + _GAIN * weight * (measured - pace)

    def closed(self, number: int) -> None:
        """A pass has ended: nobody has a part of it any more."""
        for parts in self._parts:
            parts.pop(number, None)

    def _estimates(self, now: float) -> list[float]:
        known = [pace for pace in self._paces if pace is not None]
        presumed = sum(known) / len(known) if known else 0.0
        paces = [presumed if pace is None else pace for pace in self._paces]
        if not presumed:
            return [1.0] * len(paces)
        return [min([pace, *self._late(node, pace, now)]) for node, pace in enumerate(paces)]

    def _late(self, node: int, pace: float, now: float) -> list[float]:
        """What the parts say of a node's pace that it should have done by now."""
        waits = ((part.rays, now - part.dealt_at) for part in self._parts[node].values())
        return [rays / wait_s for rays, wait_s in waits if wait_s > rays / pace + _PATIENCE_S]
