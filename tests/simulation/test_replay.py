"""If this fails, a failing seed cannot be shown again: something depends on the process, and not on the seed."""

from __future__ import annotations

from pathlib import Path

import pytest

from simulation.runs import command

SEED = "11"


def trace_of(path: Path, hash_seed: str, workload: str) -> bytes:
    done = command("--replay", SEED, "--workload", workload, "--trace", str(path), "--json", hash_seed=hash_seed)
    assert done.returncode == 0, done.stderr
    return path.read_bytes()


@pytest.mark.parametrize("workload", ["all", "keys"])
def test_one_seed_is_one_trace_in_any_process(tmp_path: Path, workload: str) -> None:
    first, second = trace_of(tmp_path / "one", "1", workload), trace_of(tmp_path / "other", "2", workload)
    different = [pair for pair in zip(first.splitlines(), second.splitlines(), strict=False) if pair[0] != pair[1]]
    assert different[:1] == []
    assert first == second
