"""Cuts a run into atoms: consecutive triangles along the curve, few enough for one record each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scenefold.base.limits import ATOM_TRIANGLES_MAX, GROUP_TRIANGLES_TARGET
from scenefold.scene.importers.runs import Run
from scenefold.scene.payloads.geometry import VertexAttributes, atom_bytes, encode_packed, fits


@dataclass(frozen=True, slots=True, eq=False)
class CutAtom:
    """An atom on its way into the store."""

    group: int
    start: int
    """Number of its first triangle in the run."""
    payload: bytes
    corners: NDArray[np.float32]
    """f32[nt, 3, 3]"""
    triangles: NDArray[np.uint32]
    """u32[nt, 3], into the attributes."""
    attributes: VertexAttributes
    materials: NDArray[np.uint16]
    low: NDArray[np.float32]
    high: NDArray[np.float32]


def group_count(run: Run) -> int:
    """How many groups a run makes: each near the target, none empty."""
    return max(1, (len(run.triangles) + GROUP_TRIANGLES_TARGET // 2) // GROUP_TRIANGLES_TARGET)


def cut(run: Run, first_group: int) -> Iterator[CutAtom]:
    """The atoms of a run, in order. An atom belongs to the group in whose share of the run it begins."""
    total, groups = len(run.triangles), group_count(run)
    pieces = -(-total // ATOM_TRIANGLES_MAX)
    bounds = [total * piece // pieces for piece in range(pieces + 1)]
    # Reversed stack: a piece that is too large for a record is cut in half, and its first half comes next.
    waiting = [(bounds[piece], bounds[piece + 1]) for piece in reversed(range(pieces))]
    while waiting:
        start, stop = waiting.pop()
        used, corners = np.unique(run.triangles[start:stop], return_inverse=True)
        materials = run.materials[start:stop]
        one = bool((materials == materials[0]).all())
        size = atom_bytes(len(used), stop - start, flags=run.attributes.flags, one_material=one)
        if not fits(size):
            middle = (start + stop) // 2
            waiting += [(middle, stop), (start, middle)]
            continue
        group = first_group + start * groups // total
        triangles = corners.reshape(-1, 3).astype(np.uint32)
        positions = run.positions[used]
        attributes = run.attributes.taken(used)
        payload = encode_packed(run.prototype, group, positions, attributes, triangles, materials)
        low, high = positions.min(axis=0), positions.max(axis=0)
        yield CutAtom(group, start, payload, positions[triangles], triangles, attributes, materials, low, high)
