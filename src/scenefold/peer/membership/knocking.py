"""Whom to ask of those that were not heard yet, and when (specs/11-peers.md, Gossip, Knocking). Pure.

In a small cluster, or where few are lacking, everybody is asked at once, then ever more slowly. Where many are lacking, only
the voter and a few others are: a thousand nodes that start at once would ask each other a million times otherwise, and who
answers has a table (tables.py). And who comes into a large cluster later tells all of itself, so it is asked only if that was lost.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence

from scenefold.base.ids import NodeId, address_of

KNOCK_S_MIN = 0.1
KNOCK_S_MAX = 2.0
"""A node that is not heard yet is asked again after 0.1 s, then ever more slowly."""
KNOCKS_MAX = 16
"""Members that may be lacking for all of them to be asked; and members that there may be for a newcomer to be asked at once."""
KNOCK_FEW = 8
"""Where more are lacking, only so many are asked, by chance: tables bring the rest, and gossip."""
KNOCK_OTHERS_S = 10.0
"""And after that time so many others, should the first be dead."""


class Knocks:
    """Remembers who was asked when. `uniform`: dice, from 0 up to 1."""

    def __init__(self, voter: NodeId, uniform: Callable[[], float]) -> None:
        self._voter = voter
        self._uniform = uniform
        self._next: dict[str, tuple[float, float]] = {}
        self._few: list[NodeId] = []
        self._others_at = -math.inf
        self._not_before: dict[NodeId, float] = {}

    def spare(self, newcomers: Iterable[NodeId], until: float, unheard: Iterable[NodeId]) -> None:
        """Do not ask these before a time. `unheard`: all that were not heard; the others are forgotten."""
        self._not_before |= dict.fromkeys(newcomers, until)
        self._not_before = {node: self._not_before[node] for node in unheard if node in self._not_before}

    def is_over_soon(self, unheard_count: int) -> bool:
        """Only a few were asked, and now so few are lacking that all can be."""
        return bool(self._few) and unheard_count <= KNOCKS_MAX

    def due(self, unheard: Sequence[NodeId], seeds: Sequence[str], now: float) -> tuple[list[str], float]:
        """Whom to ask now, of the members that were not heard and the seeds that have said nothing; and how long to pause then."""
        first_at = {address_of(node): self._not_before.get(node, now) for node in self._whom(unheard, now)}
        first_at.update(dict.fromkeys(seeds, now))
        self._next = {address: self._next.get(address, (at, KNOCK_S_MIN)) for address, at in first_at.items()}
        due = [address for address, (at, _) in self._next.items() if at <= now]
        for address in due:
            pause_s = self._next[address][1]
            self._next[address] = (now + pause_s, min(pause_s * 1.5, KNOCK_S_MAX))
        next_at = min((at for at, _ in self._next.values()), default=math.inf)
        if self._few:
            next_at = min(next_at, self._others_at)
        return due, max(KNOCK_S_MIN, next_at - now)

    def _whom(self, unheard: Sequence[NodeId], now: float) -> Sequence[NodeId]:
        if len(unheard) <= KNOCKS_MAX:
            self._few = []
            return unheard
        if not self._few or now >= self._others_at:
            drawn = [unheard[int(self._uniform() * len(unheard))] for _ in range(KNOCK_FEW)]
            self._few = list(dict.fromkeys([self._voter, *drawn]))
            self._others_at = now + KNOCK_OTHERS_S
        lacking = set(unheard)
        return [node for node in self._few if node in lacking]
