"""How many nodes stand in each render pool, by what they have memory for (specs/36-render-pools.md, *Forming*). Pure."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

Needs = Callable[[int], int]
"""Of a pool of so many nodes: bytes that the one with the largest cell takes."""


def even(nodes: int, pools: int) -> list[int]:
    """Sizes of so many pools of all nodes, or of as many as there are nodes: they differ by one at most, the larger ones first."""
    pools = min(pools, nodes)
    return [nodes // pools + (pool < nodes % pools) for pool in range(pools)]


def formed(free: Sequence[int], needs: Needs) -> list[int]:
    """Sizes of as many pools as hold a scene each, along the line; one of all nodes if not even that does. `free`: bytes that each node has."""
    sizes = _grown(free, needs)
    as_even = even(len(free), len(sizes))
    return as_even if are_enough(free, as_even, needs) else sizes


def are_enough(free: Sequence[int], sizes: Sequence[int], needs: Needs) -> bool:
    """Whether each node of pools of these sizes has what it needs."""
    ends = [0]
    for size in sizes:
        ends.append(ends[-1] + size)
    return all(_holds(free[first:end], needs) for first, end in pairwise(ends))


def _grown(free: Sequence[int], needs: Needs) -> list[int]:
    ends, first = [0], 0
    for end in range(1, len(free) + 1):
        if _holds(free[first:end], needs):
            ends.append(end)
            first = end
    if first < len(free):
        # Who is left over joins the last pool, and that the one before it, until all of it holds the scene.
        ends = [*ends[:-1], len(free)] if len(ends) > 1 else [0, len(free)]
        while len(ends) > 2 and not _holds(free[ends[-2] :], needs):
            del ends[-2]
    return [end - first for first, end in pairwise(ends)]


def _holds(free: Sequence[int], needs: Needs) -> bool:
    return min(free) >= needs(len(free))
