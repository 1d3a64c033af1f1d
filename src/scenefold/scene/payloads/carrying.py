"""Payloads whose coordinates can be carried on when their space was moved (specs/16-scene-log.md, Transforms). Pure.

Each function takes a payload and what happened to the space since it was written, and gives the payload as it is now, every number
rounded once to what it holds; None where the payload is none of its kind, or would not be one any more.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Literal

import numpy as np

from scenefold.base.errors import DamagedData
from scenefold.base.limits import COORDINATE_ABS_MAX
from scenefold.scene.log.affine import Affine
from scenefold.scene.payloads.atom_cuts import is_atom
from scenefold.scene.payloads.geometry import HEAD_BYTES, decode_atom

Carry = Callable[[bytes, Affine], bytes | None]
Kind = Literal["atoms", "float32", "float64"]
_THE_WORLD = 0


def carrier(kind: Kind) -> Carry:
    """What carries on payloads of this kind: geometry atoms, or nothing but rows of little-endian floats, one for each dimension."""
    return carry_atom if kind == "atoms" else partial(carry_rows, "<f4" if kind == "float32" else "<f8")


def carry_atom(payload: bytes, since: Affine) -> bytes | None:
    """A geometry atom of prototype 0; others lie in coordinates of their own. Normals and texture coordinates stay."""
    if not is_atom(payload) or len(since.offset) != 3:
        return None
    try:
        atom = decode_atom(payload)
    except DamagedData:
        return None
    if atom.prototype != _THE_WORLD:
        return None
    positions = since.apply(atom.positions)
    if not (np.abs(positions) <= COORDINATE_ABS_MAX).all():
        return None
    moved = positions.astype("<f4").tobytes()
    return payload[:HEAD_BYTES] + moved + payload[HEAD_BYTES + len(moved) :]


def carry_rows(kind: str, payload: bytes, since: Affine) -> bytes | None:
    """Rows of finite floats of this numpy type, and nothing else."""
    number = np.dtype(kind)
    if len(payload) % (number.itemsize * len(since.offset)):
        return None
    rows = np.frombuffer(payload, number).reshape(-1, len(since.offset))
    with np.errstate(over="ignore"):
        moved = since.apply(rows).astype(number)
    return moved.tobytes() if np.isfinite(rows).all() and np.isfinite(moved).all() else None
