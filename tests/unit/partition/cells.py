"""Partitions, points and rays for the tests of cells: ordinary ones, and every kind of degenerate one."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

from scenefold.partition import Family, Partition, camera_frame, even_bounds, limit_spans
from scenefold.partition.boxes import Cut

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


def slabs(nodes: int, rng: np.random.Generator, *, thin: bool = False) -> Partition:
    """Slices between scattered depths; thin: many of them equal, or next to each other."""
    frame = camera_frame(rng.uniform(-1, 1, 3), rng.uniform(-1, 1, 3) + np.array([0, 0, 3]), rng.uniform(-1, 1, 3))
    bounds = rng.uniform(-1, 1, nodes - 1)
    return Partition.slabs(frame, np.sort(np.round(bounds, 1) + 1e-15 * rng.integers(0, 2, nodes - 1) if thin else bounds))


def power(shape: str, nodes: int, rng: np.random.Generator) -> Partition:
    """Weights of the order of squared distances: some cells are empty, and some do not hold their centroid."""
    weights = rng.choice([0.0, 0.25, 1.0]) * rng.choice([rng.uniform(-1, 1, nodes), np.round(rng.uniform(-1, 1, nodes))])
    return Partition.power(centroids(shape, nodes, rng), weights)


def cuts(nodes: int, rng: np.random.Generator, *, thin: bool = False) -> list[Cut]:
    """Of a k-d tree with this many leaves; thin: planes on coarse steps, so that many lie on their box's rim."""

    def below(count: int, low: np.ndarray, high: np.ndarray) -> list[Cut]:
        if count == 1:
            return []
        axis, lower = int(rng.integers(3)), int(rng.integers(1, count))
        plane = float(rng.uniform(low[axis], high[axis]))
        # Rounding takes even a plain draw a last bit beyond where it ends.
        plane = float(np.clip(np.round(2 * plane) / 2 if thin else plane, low[axis], high[axis]))
        under, over = high.copy(), low.copy()
        under[axis] = over[axis] = plane
        return [Cut(axis, plane, lower), *below(lower, low, under), *below(count - lower, over, high)]

    return below(nodes, np.full(3, -1.0), np.full(3, 1.0))


OTHERS = ("wedges", "slabs", "thin slabs", "boxes", "thin boxes", *(f"power {shape}" for shape in SHAPES))
"""What is not Voronoi."""


@st.composite
def partitions(draw: st.DrawFn, shapes: tuple[str, ...] = (*SHAPES, *OTHERS)) -> tuple[Partition, np.random.Generator]:
    """A partition, and a generator for points and rays to try on it."""
    nodes, shape, rng = draw(NODES), draw(st.sampled_from(shapes)), np.random.default_rng(draw(SEEDS))
    match shape.split():
        case [*how, "wedges"]:
            return wedges(nodes, rng, even=bool(how)), rng
        case [*how, "slabs"]:
            return slabs(nodes, rng, thin=bool(how)), rng
        case [*how, "boxes"]:
            return Partition.boxes(cuts(nodes, rng, thin=bool(how))), rng
        case ["power", of]:
            return power(of, nodes, rng), rng
    return Partition.voronoi(centroids(shape, nodes, rng)), rng


def middle(partition: Partition) -> np.ndarray:
    """Some point about which cells meet."""
    data = partition.kernel_data()
    match partition.family:
        case Family.VORONOI | Family.POWER:
            return data[:, :3].mean(axis=0)
        case Family.BOXES:
            return np.zeros(3)
    return data[0]


def points(partition: Partition, rng: np.random.Generator, count: int = 200) -> np.ndarray:
    return middle(partition) + rng.normal(0.0, 1.5, (count, 3))


def directions(rng: np.random.Generator, count: int) -> np.ndarray:
    ways = rng.normal(0.0, 1.0, (count, 3))
    return ways / np.linalg.norm(ways, axis=1, keepdims=True)
