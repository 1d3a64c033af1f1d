"""How evenly each partition algorithm shares the hits of one scene, replayed round by round (specs/28-rebalancing.md).

Paths of a made-up room are traced once: camera rays, then diffuse bounces, against the planes of its walls and some balls.
Their hits, in rounds of shuffled paths, then move the cells of each algorithm. Efficiency is equation 4.19 of the thesis:
the sum of all nodes' hits over N times the sum of each round's busiest node's. Needs nothing but the project itself.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from scenefold.base.errors import LocalFault
from scenefold.partition import Frame, camera_frame
from scenefold.partition.damping import decayed
from scenefold.partition.registry import BUILT_IN, load_algorithm
from scenefold.partition.rules import Measured
from scenefold.partition.running_sample import EMPTY, extended, rays_of_round

Floats = npt.NDArray[np.float64]

BOX = np.array([[-4.0, -3.0, 0.0], [4.0, 3.0, 3.0]])
CAMERA = camera_frame([3.6, -2.6, 1.6], [-1.0, 0.7, -0.15], [0, 0, 1])
BALLS = np.array([[-1.0, 0.5, 0.6, 0.6], [1.2, 1.4, 0.4, 0.4], [-2.6, -1.6, 0.9, 0.9], [0.4, -0.8, 0.25, 0.25], [-3.0, 2.0, 1.8, 0.5]])
OF_RUNNING_SAMPLE = ("planar", "radial", "bounded-radial", "power", "kd")
"""These go by positions, so they can go by those of all rounds; loads are of the round."""
SAMPLE = 65_536


def paths(count: int, depth: int, rng: np.random.Generator) -> list[Floats]:
    """Hits of each path segment, f64[paths, 3] for each depth, NaN where a path has ended."""
    spread = rng.uniform(-1.0, 1.0, (count, 2)) * [0.75, 0.42]
    way = np.array(CAMERA.axis) + spread[:, :1] * np.array(CAMERA.quarter) + spread[:, 1:] * np.array(CAMERA.zero)
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    place, found = np.tile(CAMERA.origin, (count, 1)), []
    alive = np.ones(count, bool)
    for _ in range(depth):
        place, normal = nearest(place, way)
        found.append(np.where(alive[:, None], place, np.nan))
        bounce = normal + unit(rng.normal(0.0, 1.0, (count, 3)))
        way = unit(np.where(np.linalg.norm(bounce, axis=1, keepdims=True) > 1e-6, bounce, normal))
        alive &= rng.random(count) < 0.75
    return found


def nearest(place: Floats, way: Floats) -> tuple[Floats, Floats]:
    """Where rays that start in the room hit its walls or a ball first, and the normal there."""
    with np.errstate(divide="ignore", invalid="ignore"):
        walls = np.where(way > 0.0, BOX[1] - place, BOX[0] - place) / way
    walls = np.where(way != 0.0, np.maximum(walls, 0.0), np.inf)
    axis = walls.argmin(axis=1)
    rows = np.arange(len(place))
    t, normal = walls[rows, axis], np.zeros_like(place)
    normal[rows, axis] = -np.sign(way[rows, axis])
    for ball in BALLS:
        away = place - ball[:3]
        half = (away * way).sum(axis=1)
        square = half * half - (away * away).sum(axis=1) + ball[3] ** 2
        hit = -half - np.sqrt(np.maximum(square, 0.0))
        nearer = (square > 0.0) & (hit > 1e-6) & (hit < t)
        t = np.where(nearer, hit, t)
        normal = np.where(nearer[:, None], unit(away + hit[:, None] * way), normal)
    return place + t[:, None] * way, normal


def unit(rows: Floats) -> Floats:
    units: Floats = rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-300)
    return units


def rounds_of(hits: Sequence[Floats], most: int, *, short: bool) -> list[Floats]:
    """Hits f64[n, 3] of each round of about `most` segments, whole paths in the order in which they come."""
    table = np.stack(hits, axis=1)
    ends = np.cumsum(np.isfinite(table[:, :, 0]).sum(axis=1))
    found, begin, number = [], 0, 0
    while begin < len(table):
        size = rays_of_round(number, most) if short else most
        before = int(ends[begin - 1]) if begin else 0
        end = int(np.searchsorted(ends, before + size)) + 1
        part = table[begin:end].reshape(-1, 3)
        found.append(part[np.isfinite(part[:, 0])])
        begin, number = end, number + 1
    return found


def geometry() -> Floats:
    """Boxes of what the room is made of, f64[m, 2, 3]: a grid on its walls, and eight boxes a ball."""
    steps = [np.linspace(BOX[0, axis], BOX[1, axis], 13) for axis in range(3)]
    found = []
    for axis in range(3):
        one, two = [other for other in range(3) if other != axis]
        for edge in BOX[:, axis]:
            for i in range(12):
                for j in range(12):
                    low, high = np.empty(3), np.empty(3)
                    low[axis] = high[axis] = edge
                    low[one], high[one], low[two], high[two] = steps[one][i], steps[one][i + 1], steps[two][j], steps[two][j + 1]
                    found.append([low, high])
    for ball in BALLS:
        for corner in np.ndindex(2, 2, 2):
            sides = np.array(corner) - 1.0
            found.append([ball[:3] + ball[3] * sides, ball[:3] + ball[3] * (sides + 1.0)])
    return np.array(found)


def replay(name: str, nodes: int, rounds: Sequence[Floats], start: float, frame: Frame) -> tuple[float, float, float]:
    """E over all rounds, over their second half by segments, and seconds a round that the rule took."""
    algorithm, boxes, sample = load_algorithm(name), geometry(), EMPTY
    partition = algorithm.first(Measured(np.zeros(nodes), np.zeros((0, 3)), None, BOX, boxes), nodes, frame)
    totals, peaks, taken = [], [], 0.0
    fitted_first = name in ("power", "kd")
    done = 0
    for number, hits in enumerate(rounds):
        counts = np.bincount(partition.owner(hits), minlength=nodes)
        totals.append(int(counts.sum()))
        peaks.append(int(counts.max()))
        done += len(hits)
        began = time.perf_counter()
        sample = extended(sample, hits, number, SAMPLE)
        seen = sample.points if name in OF_RUNNING_SAMPLE else hits
        measured = Measured(counts.astype(np.float64), seen, None, BOX, boxes)
        if fitted_first and number == 0:
            partition = algorithm.first(measured, nodes, frame)
        else:
            damping = start if name in OF_RUNNING_SAMPLE else decayed(start, done, 0.5 * sum(map(len, rounds)))
            partition = algorithm.rule(partition, measured, damping)
        taken += time.perf_counter() - began
    late = np.cumsum(totals) > 0.5 * sum(totals)
    total, peak = np.array(totals), np.array(peaks)
    return (
        total.sum() / (nodes * peak.sum()),
        total[late].sum() / (nodes * peak[late].sum()),
        taken / len(rounds),
    )


def main(arguments: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--algorithms", default=",".join(BUILT_IN), help="names, with commas between them")
    parser.add_argument("--nodes", default="5,16,64,127")
    parser.add_argument("--paths", type=int, default=400_000)
    parser.add_argument("--round", type=int, default=131_072, help="segments of a round, once they are long")
    parser.add_argument("--damping", type=float, default=0.5, help="of algorithms that go by loads; decays. Fits are not damped")
    chosen = parser.parse_args(arguments)
    rounds = rounds_of(paths(chosen.paths, 12, np.random.default_rng(7)), chosen.round, short=True)
    print(f"{sum(map(len, rounds)):,} segments in {len(rounds)} rounds; E, and that of the second half")
    for name in chosen.algorithms.split(","):
        cells = []
        for nodes in map(int, chosen.nodes.split(",")):
            try:
                whole, late, seconds = replay(name, nodes, rounds, 0.0 if name in OF_RUNNING_SAMPLE else chosen.damping, CAMERA)
            except LocalFault as fault:
                print(fault, file=sys.stderr)
                return 1
            cells.append(f"{whole:.3f} {late:.3f} ({1000 * seconds:.0f} ms)")
        print(f"| {name} | {' | '.join(cells)} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
