"""How many nodes stand in each render pool (specs/36-render-pools.md, *Forming*). Pure.

Nodes are known by their places, in the order of the line.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import accumulate, pairwise

Holds = Callable[[int, int], bool]
"""Whether the nodes from one place to before another one hold the scene, as a pool."""


def even(nodes: int, pools: int) -> list[int]:
    """Sizes of so many pools of all nodes, or of as many as there are nodes: they differ by one at most, the larger ones first."""
    pools = min(pools, nodes)
    return [nodes // pools + (pool < nodes % pools) for pool in range(pools)]


def formed(nodes: int, holds: Holds) -> list[int]:
    """Sizes of as many pools as hold a scene each, along the line; one of all nodes if not even that does."""
    sizes = _grown(nodes, holds)
    as_even = even(nodes, len(sizes))
    return as_even if are_enough(as_even, holds) else sizes


def are_enough(sizes: Sequence[int], holds: Holds) -> bool:
    """Whether each pool of these sizes holds the scene."""
    return all(holds(first, end) for first, end in pairwise(accumulate(sizes, initial=0)))


def _grown(nodes: int, holds: Holds) -> list[int]:
    ends, first = [0], 0
    for end in range(1, nodes + 1):
        if holds(first, end):
            ends.append(end)
            first = end
    if first < nodes:
        # Who is left over joins the last pool, and that the one before it, until all of it holds the scene.
        ends = [*ends[:-1], nodes] if len(ends) > 1 else [0, nodes]
        while len(ends) > 2 and not holds(ends[-2], nodes):
            del ends[-2]
    return [end - first for first, end in pairwise(ends)]
