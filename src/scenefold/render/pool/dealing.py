"""Which paths of a pass other nodes than its owner trace, where every node holds the whole scene (specs/33-dealt-paths.md).

Pure; time comes in as seconds.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from scenefold.base.limits import PASS_PATHS_MAX
from scenefold.render.arrays import F64, I64, U32
from scenefold.render.ledger import Counts
from scenefold.render.passes import PassPlan
from scenefold.render.pool.pace import Pace
from scenefold.render.pool.still_open import StillOpen

PROBE_RAYS = 64
"""At least so many get those who have nothing else to do and were slow: else nobody would ever learn that they are quick again."""
PROBE_RAYS_MAX = 16_384
_PROBE_GROWTH = 4
PART_RAYS_MIN = 1_024
"""Fewer are not worth their sums."""
TRIP_S = 0.1
"""Until dealt rays are there, and what came of them is back."""
PRESUMED_PACE = 100_000.0
"""While nothing was measured of anybody, rays a second."""
_SLOW = 0.25
"""Of the best pace."""
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

    def __init__(self, plan: PassPlan, nodes: int, me: int, done: Collection[int], now: float) -> None:
        """`me`: the owner's place. `done`: passes that are traced no more."""
        self._me = me
        self._still_open = StillOpen(plan, nodes, done)
        self._paces = [Pace() for _ in range(nodes)]
        """Of parts."""
        self._parts: list[dict[int, _Part]] = [{} for _ in range(nodes)]
        """Of each node by pass: what it has not done."""
        self._done_at = [now] * nodes
        """When each was done with a part last."""
        self._rates = [Pace() for _ in range(nodes)]
        """Of its own passes."""
        self._left = [0] * nodes
        """Rays of its own passes that are not closed."""
        self._closed_at = [now] * nodes
        """When each closed a pass last."""
        self._helpers: dict[int, frozenset[int]] = {}
        self._probes = [PROBE_RAYS] * nodes
        """How many rays the next one has."""

    # What is left --------------------------------------------------------------------------------------------

    def skip(self, first: int) -> None:
        """Passes below this number were closed before."""
        self._still_open.skip(first)

    def release(self, until: int, now: float) -> None:
        """Passes below this number may be opened."""
        for node, rays in enumerate(self._still_open.release(until)):
            if rays and not self._left[node]:
                self._closed_at[node] = now
            self._left[node] += rays

    def ended(self, node: int, number: int, now: float) -> None:
        """A node has closed a pass of its own."""
        rays = self._still_open.close(number)
        if rays:
            self._rates[node].add(rays, now - self._closed_at[node])
            self._closed_at[node] = now
            self._left[node] -= rays

    # Parts ---------------------------------------------------------------------------------------------------

    def dealt(self, number: int, rays: U32, now: float) -> dict[int, U32]:
        """A pass's camera rays, by the node that gets them: ranges, one after the other."""
        found, first = {}, 0
        for node, count in enumerate(self.deal(number, len(rays), now)):
            if count:
                part = rays[first : first + count]
                found[node] = part.copy() if count < _COPIED_RAYS else part
                first += count
        return found

    def deal(self, number: int, rays: int, now: float) -> list[int]:
        """How many of a pass's rays each node gets."""
        paces, free_in = self._estimates(now)
        dealt = _whole_parts(rays, paces, free_in)
        few = (dealt < PART_RAYS_MIN) & (np.arange(len(dealt)) != self._me)
        dealt[self._me] += dealt[few].sum()
        dealt[few] = 0
        for node in self._forgotten(paces, dealt):
            most, probe = int(np.argmax(dealt)), self._probes[node]
            if dealt[most] >= 4 * probe:
                dealt[node] += probe
                dealt[most] -= probe
        for node, count in enumerate(dealt.tolist()):
            if count:
                self._parts[node][number] = _Part(count, now)
        self._helpers[number] = frozenset(np.flatnonzero(dealt).tolist()) - {self._me}
        return [int(count) for count in dealt]

    def helpers(self, number: int) -> frozenset[int]:
        """Who was dealt a part of a pass that is not closed, its owner left out."""
        return self._helpers.get(number, frozenset())

    def reported(self, number: int, node: int, counts: Counts, now: float) -> None:
        """A node's counts of a pass: its part may be done. The owner's own rays are among those that it created."""
        part = self._parts[node].get(number)
        if part is None:
            return
        if node == self._me:
            is_done = counts.retired >= part.rays and counts.created + counts.received == counts.retired + counts.sent
        else:
            is_done = counts.received >= part.rays and counts.created + counts.received == counts.retired
        if not is_done:
            return
        del self._parts[node][number]
        # What so few rays take is the way there and back: who is back in time gets more the next time, until that says something.
        is_quick = part.rays == self._probes[node] and now - part.dealt_at <= TRIP_S
        self._probes[node] = min(_PROBE_GROWTH * self._probes[node], PROBE_RAYS_MAX) if is_quick else PROBE_RAYS
        before = self._done_at[node]
        self._paces[node].add(part.rays, now - max(part.dealt_at, before), is_alone=part.dealt_at >= before and not self._parts[node])
        self._done_at[node] = now

    def closed(self, number: int, now: float) -> None:
        """A pass of the owner's has ended: nobody has a part of it any more."""
        self.ended(self._me, number, now)
        self._helpers.pop(number, None)
        for parts in self._parts:
            parts.pop(number, None)

    # Estimates -----------------------------------------------------------------------------------------------

    def _estimates(self, now: float) -> tuple[F64, F64]:
        """Of each node the rays a second that it traces of what it is dealt, and the seconds until it could begin with that."""
        rates = self._rates_of()
        measured = [pace.value for pace in self._paces if pace.value is not None]
        usual = sum(measured) / len(measured) if measured else None
        paces, free_in = [], []
        for node, pace in enumerate(self._paces):
            presumed = pace.value or self._rates[node].value or usual or rates[node]
            pace_now, parts_s = self._of_parts(node, presumed, now)
            paces.append(pace_now)
            free_in.append(parts_s if node == self._me else parts_s + self._busy_s(node, rates[node], now) + TRIP_S)
        return np.array(paces), np.array(free_in)

    def _of_parts(self, node: int, pace: float, now: float) -> tuple[float, float]:
        """A node's pace by the parts that it has not done, and how long they will take; if they are late, as long again as they did until now."""
        rays = sum(part.rays for part in self._parts[node].values())
        if not rays:
            return pace, 0.0
        waited_s = now - max(min(part.dealt_at for part in self._parts[node].values()), self._done_at[node])
        usual_s = rays / pace
        return (rays / waited_s, waited_s) if waited_s > usual_s + _PATIENCE_S else (pace, max(0.0, usual_s - waited_s))

    def _rates_of(self) -> list[float]:
        """Of each node the rays a second of its own passes, until now."""
        known = [rate.value for rate in self._rates if rate.value is not None]
        presumed = sum(known) / len(known) if known else PRESUMED_PACE
        return [presumed if rate.value is None else rate.value for rate in self._rates]

    def _busy_s(self, node: int, rate: float, now: float) -> float:
        """Until it has closed its own passes."""
        left, waited_s = self._left[node], now - self._closed_at[node]
        most_s = min(left, PASS_PATHS_MAX) / rate + _PATIENCE_S
        if not left or waited_s <= most_s:
            return max(0.0, left / rate - waited_s)
        # Who stands still takes as long again for a pass, and for the last few paths of one no less.
        return max(1.0, left / PASS_PATHS_MAX) * waited_s

    def _forgotten(self, paces: F64, dealt: I64) -> list[int]:
        """Those who have nothing to do, and get nothing because they were slow."""
        idle = [node for node in range(len(paces)) if not (self._left[node] or self._parts[node] or dealt[node]) and node != self._me]
        return [node for node in idle if self._paces[node].value is not None and paces[node] < _SLOW * paces.max()]


def _whole_parts(rays: int, paces: F64, free_in: F64) -> I64:
    """Parts of so many rays, with which all who get one are done at once, as soon as that may be."""
    order = np.argsort(free_in, kind="stable")
    taken = np.cumsum(paces[order])
    done_in = (rays + np.cumsum(paces[order] * free_in[order])) / taken
    # The more take part the sooner it is done, until somebody would begin only after that.
    enough = np.flatnonzero(done_in <= np.append(free_in[order][1:], np.inf))[0]
    exact = np.maximum(0.0, done_in[enough] - free_in) * paces
    exact *= rays / max(exact.sum(), 1e-9)
    dealt: I64 = np.floor(exact).astype(np.int64)
    dealt[np.argsort(dealt - exact, kind="stable")[: rays - int(dealt.sum())]] += 1
    return dealt
