"""A renderer without light: each path walks from square to square of a lattice, and adds a number wherever it comes.

Which squares, and which numbers, follows from seed, pixel, sample and step alone, in whole numbers (`walks.py`). So its image can be told without
any pool (`arithmetic_image.py`), bit by bit, and whatever a pool loses, doubles, mixes up or adds twice is to be seen in it. It fulfils the
contract of renderers (specs/09-renderer-contract.md) up to the light, and takes no ray that it should not have been given: none that was
changed on its way, none of another pass, none outside of its cell, and none for whose place it does not hold the square.

    the record      | word 0, 1  the walk's key | 2, 3  a seal over key, step and kind | 4  step | 5, 6  0
    (u32 [9])       | 7  path in its pass, in the upper half | 8  1: a side ray, which adds once and ends
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from scenefold.base.errors import PeerFault
from scenefold.base.rays import RAY_WORDS
from scenefold.partition import Partition
from scenefold.render.arrays import I32, I64, U32, JobNumbers
from scenefold.render.contract import Advanced, HeldScene, Tracer
from scenefold.render.pass_sums import PassSums
from scenefold.render.rehearsal.lattice import SQUARES, places_of, squares_at
from scenefold.render.rehearsal.walks import U64, added, ends_at, features, has_side_ray, keys_of, seals_of, squares_of

KEY, SEAL, STEP, PATH, SIDE_RAY = 0, 2, 4, 7, 8
"""Words of the record."""


class ArithmeticRenderer:
    """Knows the scene `lattice()`, and no other."""

    deals_paths = True

    def numeric_class(self) -> str:
        return "whole numbers"

    def open(self, held: HeldScene, numbers: JobNumbers, partition: Partition, me: int) -> ArithmeticScene:
        return ArithmeticScene(held, numbers, partition, me)


class ArithmeticScene:
    """Opened on a node's squares."""

    def __init__(self, held: HeldScene, numbers: JobNumbers, partition: Partition, me: int) -> None:
        self._numbers = numbers
        self._squares = np.zeros(len(held.arrays.instance_matrices) - 1, np.bool_)
        mine = [instance for instance, _ in held.instances]
        self._squares[squares_at(held.arrays.instance_matrices[mine, :, 3])] = True
        self._first = partition, me
        self.is_open = True

    def tracers(self, count: int) -> list[Tracer]:
        return self.tracers_in(*self._first, count)

    def tracers_in(self, partition: Partition, me: int, count: int) -> list[Tracer]:
        owners = partition.owner(places_of(np.arange(SQUARES)))
        return [ArithmeticTracer(self, self._numbers, self._squares, owners, me) for _ in range(count)]

    def close(self) -> None:
        assert self.is_open, "a scene is closed once"
        self.is_open = False


@dataclass(frozen=True, slots=True)
class ArithmeticTracer:
    """In one cell."""

    scene: ArithmeticScene
    numbers: JobNumbers
    squares: npt.NDArray[np.bool_]
    """Those that the node holds."""
    owners: I32
    """Of all squares, by the cells of one partition."""
    me: int

    def generate(self, first_path: int, count: int) -> dict[int, U32]:
        """A walk for each path, at its first square."""
        assert self.scene.is_open, "a tracer is at work on what was closed"
        paths = np.arange(count, dtype=np.uint32)
        return self.route(_records(self._keys(first_path, paths), paths, np.zeros(count, np.uint32), side=False))

    def advance(self, rays: U32, first_path: int, sums: PassSums) -> Advanced:
        """Walk on as long as this node answers for the squares."""
        assert self.scene.is_open, "a tracer is at work on what was closed"
        self._check(rays, first_path, len(sums.radiance))
        waiting, leaving, created, retired, casts, side_casts = rays, dict[int, list[U32]](), 0, 0, 0, 0
        places = []
        while len(waiting):
            keys, paths, steps, is_side = _keys_in(waiting), waiting[:, PATH] >> np.uint32(16), waiting[:, STEP], waiting[:, SIDE_RAY] != 0
            places.append(places_of(squares_of(keys, steps, is_side)))
            np.add.at(sums.radiance, paths, added(keys, steps, is_side))
            first = ~is_side & (steps == 0)
            np.add.at(sums.aovs, paths[first], features(keys[first]))
            goes_on, branches = ~is_side & ~ends_at(keys, steps), ~is_side & has_side_ray(keys, steps)
            born = _records(keys[branches], paths[branches], steps[branches], side=True)
            further = _records(keys[goes_on], paths[goes_on], steps[goes_on] + np.uint32(1), side=False)
            created, retired = created + len(born), retired + len(waiting) - len(further)
            casts, side_casts = casts + int((~is_side).sum()), side_casts + int(is_side.sum())
            owners = self.route(np.concatenate([born, further]))
            waiting = owners.pop(self.me, np.empty((0, RAY_WORDS), np.uint32))
            for node, some in owners.items():
                leaving.setdefault(node, []).append(some)
        hits = np.concatenate(places).astype(np.float32)
        gathered = {node: np.concatenate(some) for node, some in leaving.items()}
        return Advanced(gathered, created, retired, casts, side_casts, hits, len(hits))

    def route(self, rays: U32) -> dict[int, U32]:
        """By the owner of the square that each adds at next."""
        owners = self.owners[_squares_in(rays)]
        return {int(node): rays[owners == node] for node in np.unique(owners)}

    def _check(self, rays: U32, first_path: int, paths: int) -> None:
        """PeerFault for rays that nobody made so; what concerns this node alone is asserted."""
        in_pass = rays[:, PATH] >> np.uint32(16)
        keys = _keys_in(rays)
        if int(in_pass.max(initial=0)) >= paths or (keys != self._keys(first_path, in_pass)).any():
            raise PeerFault("a ray is not of the pass that it is counted in")
        seals = _doubled(rays[:, SEAL], rays[:, SEAL + 1])
        if (seals != seals_of(keys, rays[:, STEP], rays[:, SIDE_RAY] != 0)).any():
            raise PeerFault("a ray was changed on its way")
        squares = _squares_in(rays)
        assert (self.owners[squares] == self.me).all(), "a ray is traced outside of its node's cell"
        assert self.squares[squares].all(), "a ray is traced where its node holds nothing"

    def _keys(self, first_path: int, paths: U32) -> U64:
        """Of paths of a pass (specs/07-rays.md, Random numbers: which pixel and sample a path is of)."""
        numbers, among = self.numbers, np.uint64(self.numbers.crop_width * self.numbers.crop_height)
        path = np.uint64(first_path) + paths.astype(np.uint64)
        at = path % among * np.uint64(numbers.stride) % among
        column, row = at % np.uint64(numbers.crop_width), at // np.uint64(numbers.crop_width)
        pixel = (row + np.uint64(numbers.crop_y)) * np.uint64(numbers.width) + column + np.uint64(numbers.crop_x)
        return keys_of(numbers.seed, pixel, path // among)


def _records(keys: U64, paths: U32, steps: U32, *, side: bool) -> U32:
    rays = np.zeros((len(keys), RAY_WORDS), np.uint32)
    seals = seals_of(keys, steps, np.full(len(keys), side))
    for word, value in ((KEY, keys), (SEAL, seals)):
        rays[:, word], rays[:, word + 1] = value & np.uint64(0xFFFFFFFF), value >> np.uint64(32)
    rays[:, STEP], rays[:, PATH], rays[:, SIDE_RAY] = steps, paths << np.uint32(16), side
    return rays


def _keys_in(rays: U32) -> U64:
    return _doubled(rays[:, KEY], rays[:, KEY + 1])


def _squares_in(rays: U32) -> I64:
    return squares_of(_keys_in(rays), rays[:, STEP], rays[:, SIDE_RAY] != 0)


def _doubled(low: U32, high: U32) -> U64:
    words: U64 = low.astype(np.uint64) | high.astype(np.uint64) << np.uint64(32)
    return words
