"""Damping: how much of a proposed move is left undone (thesis 3.3.8, 5.3; specs/28-rebalancing.md, Damping)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from scenefold.base.errors import LocalFault

Floats = npt.NDArray[np.float64]


def checked(damping: float) -> float:
    """LocalFault unless it lies in 0 to 1."""
    if not 0.0 <= damping <= 1.0:
        raise LocalFault(f"damping lies between 0 and 1, not at {damping}")
    return damping


def decayed(start: float, rays: float, half: float) -> float:
    """Damping after this many rays in all: what moves are left halves with every `half` rays (thesis 5.3)."""
    if not (half > 0.0 and rays >= 0.0):
        raise LocalFault("decay needs a positive number of rays to halve in, and no negative number of rays cast")
    return 1.0 - (1.0 - checked(start)) * float(2.0 ** (-rays / half))


def damped(old: Floats, new: Floats, damping: float) -> Floats:
    """old + (1 - damping) (new - old)."""
    return old + (1.0 - checked(damping)) * (new - old)
