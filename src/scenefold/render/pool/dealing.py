"""Which paths of a pass other render pools than its owner's trace, each of which holds the whole scene (specs/33-dealt-paths.md, 36-render-pools.md).

Pure; time comes in as seconds.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
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
    """Of one pass, at one pool."""

    rays: int
    dealt_at: float


class Dealer:
    """Of one owner's passes, among so many pools. Nodes are known by their places, pools by their numbers."""

    def __init__(self, plan: PassPlan, pools: Sequence[range], me: int, done: Collection[int], now: float) -> None:
        """`pools`: the places of each pool's nodes, one after the other. `me`: the owner's place. `done`: passes that are traced no more."""
        self._me, self._pools = me, pools
        self._pool_of = [pool for pool, places in enumerate(pools) for _ in places]
        self._mine = self._pool_of[me]
        self._still_open = StillOpen(plan, len(self._pool_of), done)
        self._paces = [Pace() for _ in pools]
        """Of parts."""
        self._parts: list[dict[int, _Part]] = [{} for _ in pools]
        """Of each pool by pass: what it has not done."""
        self._counts: dict[int, dict[int, Counts]] = {}
        """Of the owner's open passes: what each node told of them."""
        self._done_at = [now] * len(pools)
        """When each was done with a part last."""
        self._rates = [Pace() for _ in pools]
        """Of passes that its nodes own."""
        self._left = [0] * len(pools)
        """Rays of such that are not closed."""
        self._closed_at = [now] * len(pools)
        """When each closed a pass last."""
        self._helpers: dict[int, frozenset[int]] = {}
        self._probes = [PROBE_RAYS] * len(pools)
        """How many rays the next one has."""

    # What is left --------------------------------------------------------------------------------------------

    def skip(self, first: int) -> None:
        """Passes below this number were closed before."""
        self._still_open.skip(first)

    def release(self, until: int, now: float) -> None:
        """Passes below this number may be opened."""
        rays_of = self._still_open.release(until)
        for pool, places in enumerate(self._pools):
            rays = sum(rays_of[place] for place in places)
            if rays and not self._left[pool]:
                self._closed_at[pool] = now
            self._left[pool] += rays

    def ended(self, node: int, number: int, now: float) -> None:
        """A node has closed a pass of its own."""
        rays, pool = self._still_open.close(number), self._pool_of[node]
        if rays:
            self._rates[pool].add(rays, now - self._closed_at[pool])
            self._closed_at[pool] = now
            self._left[pool] -= rays

    # Parts ---------------------------------------------------------------------------------------------------

    def dealt(self, number: int, rays: Mapping[int, U32], now: float) -> tuple[dict[int, U32], dict[int, U32]]:
        """A pass's camera rays, by whatever they are divided: those that stay, divided likewise, and those that others get, by place."""
        counts = self.deal(number, sum(map(len, rays.values())), now)
        stay: dict[int, list[U32]] = {}
        away: dict[int, list[U32]] = {}
        pool, room = -1, 0
        for key, some in rays.items():
            first = 0
            while first < len(some):
                while not room:
                    pool += 1
                    room = counts[pool]
                part = some[first : first + room]
                first, room = first + len(part), room - len(part)
                places = self._pools[pool]
                into, where = (stay, key) if pool == self._mine else (away, places[number % len(places)])
                into.setdefault(where, []).append(part)
        return _joined(stay), _joined(away)

    def deal(self, number: int, rays: int, now: float) -> list[int]:
        """How many of a pass's rays each pool gets."""
        paces, free_in = self._estimates(now)
        dealt = _whole_parts(rays, paces, free_in)
        few = (dealt < PART_RAYS_MIN) & (np.arange(len(dealt)) != self._mine)
        dealt[self._mine] += dealt[few].sum()
        dealt[few] = 0
        for pool in self._forgotten(paces, dealt):
            most, probe = int(np.argmax(dealt)), self._probes[pool]
            if dealt[most] >= 4 * probe:
                dealt[pool] += probe
                dealt[most] -= probe
        for pool, count in enumerate(dealt.tolist()):
            if count:
                self._parts[pool][number] = _Part(count, now)
        helpers = (self._pools[pool] for pool in np.flatnonzero(dealt).tolist() if pool != self._mine)
        self._helpers[number] = frozenset(place for places in helpers for place in places)
        return [int(count) for count in dealt]

    def helpers(self, number: int) -> frozenset[int]:
        """All nodes of other pools that were dealt a part of a pass that is not closed."""
        return self._helpers.get(number, frozenset())

    def reported(self, number: int, node: int, counts: Counts, now: float) -> None:
        """A node's counts of a pass: its pool's part may be done. The owner's own rays are among those that it created."""
        pool = self._pool_of[node]
        part = self._parts[pool].get(number)
        if part is None:
            return
        told = self._counts.setdefault(number, {})
        told[node] = counts
        total = sum((told[place] for place in self._pools[pool] if place in told), start=Counts())
        has_come = total.retired >= part.rays if pool == self._mine else total.received - total.sent >= part.rays
        if not has_come or total.created + total.received != total.retired + total.sent:
            return
        del self._parts[pool][number]
        # What so few rays take is the way there and back: who is back in time gets more the next time, until that says something.
        is_quick = part.rays == self._probes[pool] and now - part.dealt_at <= TRIP_S
        self._probes[pool] = min(_PROBE_GROWTH * self._probes[pool], PROBE_RAYS_MAX) if is_quick else PROBE_RAYS
        before = self._done_at[pool]
        self._paces[pool].add(part.rays, now - max(part.dealt_at, before), is_alone=part.dealt_at >= before and not self._parts[pool])
        self._done_at[pool] = now

    def closed(self, number: int, now: float) -> None:
        """A pass of the owner's has ended: nobody has a part of it any more."""
        self.ended(self._me, number, now)
        self._helpers.pop(number, None)
        self._counts.pop(number, None)
        for parts in self._parts:
            parts.pop(number, None)

    # Estimates -----------------------------------------------------------------------------------------------

    def _estimates(self, now: float) -> tuple[F64, F64]:
        """Of each pool the rays a second that it traces of what it is dealt, and the seconds until it could begin with that."""
        rates = self._rates_of()
        measured = [pace.value for pace in self._paces if pace.value is not None]
        usual = sum(measured) / len(measured) if measured else None
        paces, free_in = [], []
        for pool, pace in enumerate(self._paces):
            presumed = pace.value or self._rates[pool].value or usual or rates[pool]
            pace_now, parts_s = self._of_parts(pool, presumed, now)
            paces.append(pace_now)
            # Its own passes a pool traces itself, unless others have nothing to do.
            free_in.append(parts_s if pool == self._mine else parts_s + self._busy_s(pool, rates[pool], now) + TRIP_S)
        return np.array(paces), np.array(free_in)

    def _of_parts(self, pool: int, pace: float, now: float) -> tuple[float, float]:
        """A pool's pace by the parts that it has not done, and how long they will take; if they are late, as long again as they did until now."""
        rays = sum(part.rays for part in self._parts[pool].values())
        if not rays:
            return pace, 0.0
        waited_s = now - max(min(part.dealt_at for part in self._parts[pool].values()), self._done_at[pool])
        usual_s = rays / pace
        return (rays / waited_s, waited_s) if waited_s > usual_s + _PATIENCE_S else (pace, max(0.0, usual_s - waited_s))

    def _rates_of(self) -> list[float]:
        """Of each pool the rays a second of its nodes' own passes, until now."""
        known = [rate.value for rate in self._rates if rate.value is not None]
        presumed = sum(known) / len(known) if known else PRESUMED_PACE
        return [presumed if rate.value is None else rate.value for rate in self._rates]

    def _busy_s(self, pool: int, rate: float, now: float) -> float:
        """Until its nodes have closed their own passes."""
        left, waited_s = self._left[pool], now - self._closed_at[pool]
        most_s = min(left, PASS_PATHS_MAX) / rate + _PATIENCE_S
        if not left or waited_s <= most_s:
            return max(0.0, left / rate - waited_s)
        # Who stands still takes as long again for a pass, and for the last few paths of one no less.
        return max(1.0, left / PASS_PATHS_MAX) * waited_s

    def _forgotten(self, paces: F64, dealt: I64) -> list[int]:
        """Those who have nothing to do, and get nothing because they were slow."""
        idle = [pool for pool in range(len(paces)) if not (self._left[pool] or self._parts[pool] or dealt[pool]) and pool != self._mine]
        return [pool for pool in idle if self._paces[pool].value is not None and paces[pool] < _SLOW * paces.max()]


def _joined(parts: Mapping[int, Sequence[U32]]) -> dict[int, U32]:
    """Few rays of many are copied, or they would keep all of these in memory for as long as they wait."""
    joined = {}
    for key, pieces in parts.items():
        one = pieces[0] if len(pieces) == 1 else np.concatenate(pieces)
        joined[key] = one.copy() if len(pieces) == 1 and len(one) < _COPIED_RAYS else one
    return joined


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
