"""Hits of all rounds so far, as a sample of bounded size, and how long rounds are (specs/28-rebalancing.md, Ours).

Every hit draws a number; those with the lowest numbers stay. So a sample of a sample is one of all, each hit has the
same odds whichever round it came in, and old rounds lose weight only as new ones come.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from scenefold.base.errors import LocalFault

Floats = npt.NDArray[np.float64]

FIRST_RAYS = 4096
"""Of the first round."""


class RunningSample(NamedTuple):
    """Points f64[n, 3] with the numbers that they drew, f64[n], ascending."""

    points: Floats
    draws: Floats


EMPTY = RunningSample(np.zeros((0, 3)), np.zeros(0))


def extended(sample: RunningSample, hits: npt.ArrayLike, seed: int, kept: int) -> RunningSample:
    """The sample with a round's hits, f64[n, 3], cut to `kept` points. Another seed for each round, and each node."""
    new = np.asarray(hits, np.float64).reshape(-1, 3)
    if kept < 1 or not np.isfinite(new).all():
        raise LocalFault("a sample keeps one point at least, and takes finite ones alone")
    drawn = np.random.Generator(np.random.PCG64(seed)).random(len(new))
    draws = np.concatenate([sample.draws, drawn])
    order = np.argsort(draws, kind="stable")[:kept]
    return RunningSample(np.concatenate([sample.points, new])[order], draws[order])


def rays_of_round(number: int, most: int, first: int = FIRST_RAYS) -> int:
    """Rays of round 0, 1, …: doubled from `first` on, up to `most`. Early fits cost little, and are soon replaced."""
    return min(most, first << min(number, 62))
