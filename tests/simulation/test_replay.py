"""If this fails, a failing seed cannot be shown again: something depends on the process, and not on the seed."""

from __future__ import annotations

import json
from pathlib import Path

from simulation.runs import command

SEED = "11"


def trace_of(path: Path, hash_seed: str) -> bytes:
    done = command("--replay", SEED, "--trace", str(path), "--json", hash_seed=hash_seed)
    assert done.returncode == 0, done.stderr
    return path.read_bytes()


def test_one_seed_is_one_trace_in_any_process(tmp_path: Path) -> None:
    first, second = trace_of(tmp_path / "one", "1"), trace_of(tmp_path / "other", "2")
    different = [pair for pair in zip(first.splitlines(), second.splitlines(), strict=False) if pair[0] != pair[1]]
    assert different[:1] == []
    assert first == second


def test_the_report_has_its_four_keys_and_nothing_else() -> None:
    done = command("--seeds", "3:5", "--json", "--workload", "data", "--seconds", "20")
    report = json.loads(done.stdout)
    assert set(report) == {"seeds", "violations", "faults", "operations"}
    assert (report["seeds"], report["violations"], done.returncode) == (2, [], 0)
    assert report["operations"] > 0
    assert sum(report["faults"].values()) > 0


def test_wrong_usage_ends_with_two() -> None:
    for arguments in (
        ["--seeds", "5:5"],
        ["--seeds", "x"],
        ["--mutant", "nobody"],
        ["--nodes", "1"],
        ["--seconds", "1"],
        ["--nonsense"],
        ["--keep", "1"],
        ["--replay", "1", "--keep", "99"],
    ):
        assert command(*arguments).returncode == 2, arguments
