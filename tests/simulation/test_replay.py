"""If this fails, a failing seed cannot be shown again: something depends on the process, and not on the seed."""

from __future__ import annotations

import multiprocessing
from pathlib import Path

import pytest

from scenefold.simulation.crowd import run_one
from scenefold.simulation.outcome import Order
from simulation.runs import command

SEED = "11"
SMALLER = {"logs": ("--participants", "3", "--seconds", "20", "--faults", "crash,loss,cut-off client"), "renders": ("--seconds", "20")}
"""Of each packet there is more to do where several decide."""


def trace_of(path: Path, hash_seed: str, workload: str) -> bytes:
    done = command(
        "--replay", SEED, "--workload", workload, *SMALLER.get(workload, ()), "--trace", str(path), "--json", hash_seed=hash_seed
    )
    assert done.returncode == 0, done.stderr
    return path.read_bytes()


@pytest.mark.parametrize(
    "workload", ["all", pytest.param("keys", marks=pytest.mark.long), "logs", pytest.param("renders", marks=pytest.mark.long)]
)
def test_one_seed_is_one_trace_in_any_process(tmp_path: Path, workload: str) -> None:
    first, second = trace_of(tmp_path / "one", "1", workload), trace_of(tmp_path / "other", "2", workload)
    different = [pair for pair in zip(first.splitlines(), second.splitlines(), strict=False) if pair[0] != pair[1]]
    assert different[:1] == []
    assert first == second


def test_a_process_that_has_run_other_seeds_runs_one_as_a_fresh_one_does() -> None:
    order, other = Order(11, storm_s=20.0), Order(12, storm_s=20.0, workload="keys")
    with multiprocessing.get_context("spawn").Pool(1) as fresh:
        first = fresh.apply(run_one, (order,))
        fresh.apply(run_one, (other,))
        again = fresh.apply(run_one, (order,))
    assert (again.trace_hash, again.operations, again.faults) == (first.trace_hash, first.operations, first.faults)
