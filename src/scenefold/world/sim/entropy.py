"""Randomness from a seed (port `Entropy`).

Each stream has a name and depends on the seed and that name alone, so that one node's draws never shift another's, and
a fault that is taken out of a schedule leaves all other dice as they were.
"""

from __future__ import annotations

import hashlib
import random


def dice(seed: int, name: str) -> random.Random:
    """The stream of a name: the same in every process and under every PYTHONHASHSEED."""
    return random.Random(hashlib.sha256(f"{seed} {name}".encode()).digest())


class SimEntropy:
    """Draws of one process. Fit for simulations only: who knows the seed knows every key."""

    def __init__(self, seed: int, name: str) -> None:
        self._dice = dice(seed, name)

    def token(self, count: int) -> bytes:
        return self._dice.randbytes(count)

    def uniform(self) -> float:
        return self._dice.random()
