"""The chance that a silent node is alive (thesis C.1; specs/11-peers.md, Roster). Pure.

p(alive) = ((N-1)/N)^B: all N nodes throw the same dice, so each is equally likely to be the author of the next
broadcast, and a living one has been the author of none of B with this probability.
"""

from __future__ import annotations

import math

ALIVE_CHANCE_MIN = 1 / 20
"""Below this chance a peer is no longer believed alive (thesis C.1)."""


def chance_alive(count: int, missed: int) -> float:
    """((N-1)/N)^B: the chance that a living one of `count` nodes is the author of none of `missed` broadcasts."""
    return float(((count - 1) / count) ** missed)


def broadcasts_missed_max(count: int) -> int:
    """The largest B at which a peer is still believed alive among `count` nodes, about 3 N."""
    if count < 2:
        return 0
    missed = int(math.log(ALIVE_CHANCE_MIN) / math.log((count - 1) / count))
    # Logarithms round: the definition decides.
    while chance_alive(count, missed + 1) >= ALIVE_CHANCE_MIN:
        missed += 1
    while chance_alive(count, missed) < ALIVE_CHANCE_MIN:
        missed -= 1
    return missed
