"""Runs of the simulation for tests: in a process of their own where that matters, with stories when they fail."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterable

import pytest

from scenefold.simulation.crowd import run_all
from scenefold.simulation.outcome import Order, Result


def run_seeds(seeds: Iterable[int], **options: object) -> list[Result]:
    """Run seeds on two processes, in order."""
    orders = [Order(seed, **options) for seed in seeds]  # type: ignore[arg-type]
    return sorted(run_all(orders, 2), key=lambda result: result.order.seed)


def fail_with_stories(results: list[Result]) -> None:
    """Fail the test with what happened, if anything was violated."""
    stories = [result.story for result in results if result.violations]
    if stories:
        pytest.fail("\n".join(stories[:2]), pytrace=False)


def command(*arguments: str, hash_seed: str = "0") -> subprocess.CompletedProcess[str]:
    """`python -m scenefold.simulation` as people call it."""
    environment = {**os.environ, "PYTHONHASHSEED": hash_seed}
    line = [sys.executable, "-m", "scenefold.simulation", *arguments]
    return subprocess.run(line, capture_output=True, text=True, env=environment, check=False, timeout=100)
