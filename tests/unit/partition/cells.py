"""Partitions, points and rays for the tests of cells: ordinary ones, and every kind of degenerate one."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

from scenefold.partition import Partition, camera_frame, even_bounds, limit_spans

NODES = st.one_of(st.integers(1, 9), st.sampled_from([16, 33, 64, 127]))
SEEDS = st.integers(0, 2**32 - 1)
SHAPES = ["scattered", "collinear", "coplanar", "cocircular", "grid", "coincident", "pairs", "tight", "far"]


def centroids(shape: str, nodes: int, rng: np.random.Generator) -> np.ndarray:
    scattered = rng.uniform(-1.0, 1.0, (nodes, 3))
    match shape:
        case "collinear":
            return rng.uniform(-1, 1, 3) + np.outer(rng.uniform(-1, 1, nodes), rng.uniform(-1, 1, 3))
        case "coplanar":
            return scattered * [1.0, 1.0, 0.0]
        case "cocircular":
            turns = 2 * np.pi * np.arange(nodes) / nodes
            return np.stack([np.cos(turns), np.sin(turns), np.zeros(nodes)], axis=1)
        case "grid":
            return np.stack([np.arange(nodes) % 5, np.arange(nodes) // 5 % 5, np.arange(nodes) // 25], axis=1) / 2.0 - 1.0
        case "coincident":
            return np.tile(scattered[:1], (nodes, 1))
        case "pairs":
            return scattered[np.arange(nodes) // 2]
        case "tight":
            return scattered[:1] + 1e-14 * scattered
        case "far":
            return scattered + np.array([1e6, -1e6, 1e6])
        case _:
            return scattered


def wedges(nodes: int, rng: np.random.Generator, *, even: bool = False) -> Partition:
    frame = camera_frame(rng.uniform(-1, 1, 3), rng.uniform(-1, 1, 3) + np.array([0, 0, 3]), rng.uniform(-1, 1, 3))
    bounds = rng.uniform(0, 1, nodes - 1) ** rng.choice([0.2, 1.0, 4.0])
    return Partition.wedges(frame, even_bounds(nodes) if even else limit_spans(np.sort(bounds)))


@st.composite
def partitions(draw: st.DrawFn, shapes: tuple[str, ...] = (*SHAPES, "wedges")) -> tuple[Partition, np.random.Generator]:
    """A partition, and a generator for points and rays to try on it."""
    nodes, shape, rng = draw(NODES), draw(st.sampled_from(shapes)), np.random.default_rng(draw(SEEDS))
    if shape in ("wedges", "even wedges"):
        return wedges(nodes, rng, even=shape == "even wedges"), rng
    return Partition.voronoi(centroids(shape, nodes, rng)), rng


def middle(partition: Partition) -> np.ndarray:
    """Some point about which cells meet."""
    data = partition.kernel_data()
    return data[0] if len(data) > partition.nodes else data.mean(axis=0)


def points(partition: Partition, rng: np.random.Generator, count: int = 200) -> np.ndarray:
    return middle(partition) + rng.normal(0.0, 1.5, (count, 3))


def directions(rng: np.random.Generator, count: int) -> np.ndarray:
    ways = rng.normal(0.0, 1.0, (count, 3))
    return ways / np.linalg.norm(ways, axis=1, keepdims=True)
