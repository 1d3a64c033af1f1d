"""If this failed, a seed that found a bug would not find it again."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from unit.world.sim.scenario import run

TESTS = Path(__file__).parents[3]
PINNED_SEED = 7
PINNED_HASH = "e6aa3e5cf2edfca955eb3ebb2797f91b839bba4a858ce2d7387cbb02d3095739"
"""Changes with everything that changes what the scenario does, and with Trio; it must not change by itself."""

pytestmark = [
    pytest.mark.expect_log("connection was|is gone|closed|timed out"),
]


def hash_in_a_process(hash_seed: str, seed: int) -> str:
    """The scenario's hash as a fresh interpreter finds it, whose sets and dicts of texts are ordered otherwise."""
    done = subprocess.run(
        [sys.executable, "-m", "unit.world.sim.scenario", str(seed)],
        env={**os.environ, "PYTHONHASHSEED": hash_seed, "PYTHONPATH": f"{TESTS}{os.pathsep}{TESTS.parent / 'src'}"},
        capture_output=True,
        text=True,
        check=True,
        timeout=100,
    )
    return done.stdout.strip()


def test_one_seed_one_trace_in_any_process() -> None:
    assert hash_in_a_process("1", PINNED_SEED) == hash_in_a_process("2", PINNED_SEED) == run(PINNED_SEED).trace.hash


def test_the_trace_of_a_seed_is_the_one_that_it_was() -> None:
    net = run(PINNED_SEED)
    assert net.trace.hash == PINNED_HASH
    kinds = net.trace.counts
    assert min(kinds["crash"], kinds["cut"], kinds["partition"], kinds["after-commit"], kinds["tcp-arrive"]) > 0


def test_another_seed_is_another_run() -> None:
    assert run(PINNED_SEED + 1).trace.hash != run(PINNED_SEED).trace.hash
