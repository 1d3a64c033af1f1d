"""How evenly each partition algorithm shares the work of one scene, replayed round by round (specs/28-rebalancing.md).

Paths of a made-up room are traced once: camera rays, then diffuse bounces, against the planes of its walls and some balls.
Their hits, in rounds of shuffled paths, then move the cells of each algorithm. Efficiency is equation 4.19 of the thesis:
the sum of all nodes' hits over N times the sum of each round's busiest node's. Needs nothing but the project itself.

With --scene the segments are those that the project's renderer casts for an image of a file, and work is what a node does: a visit of
its cell by a segment. What a hit weighs is then the visits of its node over its hits, as the seconds of nodes are in a render. Speed-up is the
visits of all nodes over those of each round's busiest, and, as cells bring visits that one node would not have, segments over the same.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from scenefold.base.errors import LocalFault
from scenefold.partition import Frame, Partition, camera_frame
from scenefold.partition.damping import decayed
from scenefold.partition.registry import BUILT_IN, load_algorithm
from scenefold.partition.rules import Measured
from scenefold.partition.running_sample import rays_of_round

if TYPE_CHECKING:
    from captured_segments import Segments

Floats = npt.NDArray[np.float64]

BOX = np.array([[-4.0, -3.0, 0.0], [4.0, 3.0, 3.0]])
CAMERA = camera_frame([3.6, -2.6, 1.6], [-1.0, 0.7, -0.15], [0, 0, 1])
BALLS = np.array([[-1.0, 0.5, 0.6, 0.6], [1.2, 1.4, 0.4, 0.4], [-2.6, -1.6, 0.9, 0.9], [0.4, -0.8, 0.25, 0.25], [-3.0, 2.0, 1.8, 0.5]])
OF_RUNNING_SAMPLE = ("planar", "radial", "bounded-radial", "power", "kd")
"""These go by positions, so they can go by those of all rounds; loads are of the round."""
SAMPLE = 65_536
CROSSED_MAX = 1024
SCENE_RAYS = 4096
"""Of the first round of a scene; the next ones are twice as long each."""


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


class Work(Protocol):
    """What the nodes do in a round."""

    @property
    def ends(self) -> Floats:
        """f64[m, 3]: where its segments hit something."""
        ...

    @property
    def segments(self) -> int:
        """How many there are."""
        ...

    def by_node(self, partition: Partition) -> Floats:
        """f64[N]."""
        ...


class Hits(NamedTuple):
    """Of segments of which nothing but their ends is known: each is work of the node where it ends."""

    ends: Floats

    @property
    def segments(self) -> int:
        return len(self.ends)

    def by_node(self, partition: Partition) -> Floats:
        return np.bincount(partition.owner(self.ends), minlength=partition.nodes).astype(np.float64)


class Visits:
    """Of whole segments: each is work of all nodes whose cells it crosses until it ends."""

    def __init__(self, segments: Segments) -> None:
        self._of = segments
        self.ends = segments.ends

    @property
    def segments(self) -> int:
        return len(self._of)

    def by_node(self, partition: Partition) -> Floats:
        origins, directions, reaches = self._of.origins, self._of.directions, self._of.reaches
        nodes, t = partition.owner(origins, directions), np.zeros(len(reaches))
        visits = np.bincount(nodes, minlength=partition.nodes).astype(np.float64)
        for _ in range(CROSSED_MAX):
            t, targets = partition.exit(origins, directions, t, nodes)
            on = (t < reaches) & (targets >= 0)
            if not on.any():
                return visits
            origins, directions, reaches, t, nodes = origins[on], directions[on], reaches[on], t[on], targets[on]
            visits += np.bincount(nodes, minlength=partition.nodes)
        raise LocalFault(f"a segment crosses more than {CROSSED_MAX} cells", remedy="report that")


class Sample:
    """Hits of all rounds, each as likely as any other, and what each weighs."""

    def __init__(self) -> None:
        self._dice = np.random.default_rng(3)
        self._keys, self.points, self.weights = np.zeros(0), np.zeros((0, 3)), np.zeros(0)

    def add(self, points: Floats, weights: Floats) -> None:
        keys = np.concatenate([self._keys, self._dice.random(len(points))])
        kept = np.argsort(keys)[:SAMPLE]
        self._keys = keys[kept]
        self.points = np.concatenate([self.points, points])[kept]
        self.weights = np.concatenate([self.weights, weights])[kept]


class Shared(NamedTuple):
    """How evenly work was shared."""

    efficiency: float
    late: float
    """Of the second half of the segments."""
    speed_up: float
    """Work of all over that of each round's busiest node, in the second half;"""
    of_segments: float
    """and segments over the same."""
    rule_s: float
    """Of a round."""


def replay(
    name: str, first: Partition | None, nodes: int, rounds: Sequence[Work], start: float, frame: Frame, box: Floats, geometry: Floats
) -> Shared:
    """Round by round. `first`: the cells with which a render begins; None: as the algorithm says."""
    algorithm, sample = load_algorithm(name), Sample()
    partition = algorithm.first(Measured(np.zeros(nodes), np.zeros((0, 3)), None, box, geometry), nodes, frame) if first is None else first
    totals, peaks, sizes, taken = [], [], [], 0.0
    fitted_first = first is None and name in ("power", "kd")
    done, everything = 0, sum(work.segments for work in rounds)
    for number, work in enumerate(rounds):
        loads = work.by_node(partition)
        totals.append(loads.sum())
        peaks.append(loads.max())
        sizes.append(work.segments)
        done += work.segments
        began = time.perf_counter()
        owners = partition.owner(work.ends)
        weights = (loads / np.maximum(np.bincount(owners, minlength=nodes), 1))[owners]
        sample.add(work.ends, weights)
        is_of_all = name in OF_RUNNING_SAMPLE
        measured = Measured(loads, sample.points if is_of_all else work.ends, sample.weights if is_of_all else weights, box, geometry)
        if fitted_first and number == 0:
            partition = algorithm.first(measured, nodes, frame)
        else:
            damping = start if is_of_all else decayed(start, done, 0.5 * everything)
            partition = algorithm.rule(partition, measured, damping)
        taken += time.perf_counter() - began
    total, peak, size = np.array(totals), np.array(peaks), np.array(sizes)
    late = np.cumsum(size) > 0.5 * size.sum()
    return Shared(
        total.sum() / (nodes * peak.sum()),
        total[late].sum() / (nodes * peak[late].sum()),
        total[late].sum() / peak[late].sum(),
        size[late].sum() / peak[late].sum(),
        taken / len(rounds),
    )


def rounds_of_scene(segments: Segments, most: int) -> list[Work]:
    """Its first round is short, each is twice as long as the one before up to the longest."""
    found, begin, size = list[Work](), 0, SCENE_RAYS
    while begin < len(segments):
        found.append(Visits(segments.part(begin, begin + size)))
        begin, size = begin + size, min(2 * size, most)
    return found


def main(arguments: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--algorithms", default=",".join(BUILT_IN), help="names, with commas between them")
    parser.add_argument("--nodes", default="5,16,64,127")
    parser.add_argument("--scene", type=Path, help="a file; without it the made-up room")
    parser.add_argument("--sky", default="0.5,0.6,0.7", help="of a scene: its uniform sky, R,G,B")
    parser.add_argument("--segments", type=int, default=2_000_000, help="of a scene: about so many")
    parser.add_argument("--paths", type=int, default=400_000, help="of the room")
    parser.add_argument("--round", type=int, default=131_072, help="segments of a round, once they are long")
    parser.add_argument("--damping", type=float, default=0.5, help="of algorithms that go by loads; decays. Fits are not damped")
    chosen = parser.parse_args(arguments)
    try:
        if chosen.scene is None:
            of_room(chosen)
        else:
            of_scene(chosen)
    except LocalFault as fault:
        print(fault, file=sys.stderr)
        return 1
    return 0


def of_room(chosen: argparse.Namespace) -> None:
    rounds: list[Work] = [Hits(hits) for hits in rounds_of(paths(chosen.paths, 12, np.random.default_rng(7)), chosen.round, short=True)]
    print(f"{sum(work.segments for work in rounds):,} segments in {len(rounds)} rounds; E, and that of the second half")
    for name in chosen.algorithms.split(","):
        cells = []
        for nodes in map(int, chosen.nodes.split(",")):
            start = 0.0 if name in OF_RUNNING_SAMPLE else chosen.damping
            shared = replay(name, None, nodes, rounds, start, CAMERA, BOX, geometry())
            cells.append(f"{shared.efficiency:.3f} {shared.late:.3f} ({1000 * shared.rule_s:.0f} ms)")
        print(f"| {name} | {' | '.join(cells)} |", flush=True)


def of_scene(chosen: argparse.Namespace) -> None:
    from captured_segments import captured
    from scenefold.render.first_cells import first_cells
    from scenefold.render.job import RenderOptions

    red, green, blue = map(float, chosen.sky.split(","))
    # Whole passes of a usual image, in the order in which they would be traced.
    scene, segments = captured(chosen.scene, RenderOptions(sky=(red, green, blue)), chosen.segments)
    matrix = np.asarray(scene.camera.matrix, np.float64)
    frame = camera_frame(matrix[:3, 3], -matrix[:3, 2], matrix[:3, 1])
    rounds = rounds_of_scene(segments, chosen.round)
    print(f"{chosen.scene.name}: {len(segments):,} segments in {len(rounds)} rounds")
    print("E by visits, that of the second half; there: speed-up by visits, by segments")
    for name in chosen.algorithms.split(","):
        cells = []
        for nodes in map(int, chosen.nodes.split(",")):
            start = 0.0 if name in OF_RUNNING_SAMPLE else chosen.damping
            first = first_cells(name, nodes, scene.tables, scene.camera)
            one = replay(name, first, nodes, rounds, start, frame, scene.box, scene.geometry)
            cells.append(f"{one.efficiency:.3f} {one.late:.3f}; {one.speed_up:.1f} {one.of_segments:.1f}")
        print(f"| {name} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
