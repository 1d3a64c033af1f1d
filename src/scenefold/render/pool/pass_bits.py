"""Sets of passes, as nodes tell them each other: bit p mod 8 of byte p div 8, from the least, is pass p (specs/31-attempts.md). Pure."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from scenefold.base.errors import PeerFault


def bits_of(passes: Collection[int], count: int) -> bytes:
    """Of passes among so many."""
    table = np.zeros(count, np.bool_)
    table[np.fromiter(passes, np.int64, len(passes))] = True
    return np.packbits(table, bitorder="little").tobytes()


def passes_of(bits: object, count: int) -> frozenset[int]:
    """What `bits_of` gave; PeerFault for anything else."""
    if not isinstance(bits, bytes) or len(bits) != -(-count // 8):
        raise PeerFault("a set of passes is ill-formed")
    table = np.unpackbits(np.frombuffer(bits, np.uint8), bitorder="little")
    if table[count:].any():
        raise PeerFault("a set has passes that the job does not have")
    return frozenset(map(int, np.flatnonzero(table)))
