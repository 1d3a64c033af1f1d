"""If this fails, a rule of consensus, leases or lives does not keep what specs/25-consensus.md and specs/26-modes.md promise,
or the models no longer notice when one is left out."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = ROOT / "tools" / "check_models.py"
MODELS = ROOT / "specs" / "models"
SKIPPED = 77

HOLDS = """
State-vector 64 byte, depth reached 24, errors: 0
    28705 states, stored
"""
FOUND = """pan:1: assertion violated ((chosen[c[me]]==0)||(chosen[c[me]]==v)) (at depth 12)
pan: wrote consensus.pml.trail
Warning: Search not completed
State-vector 64 byte, depth reached 16, errors: 1
       85 states, stored
"""


@pytest.fixture(name="checker", scope="module")
def load_checker() -> ModuleType:
    sys.path.insert(0, str(SCRIPT.parent))
    try:
        spec = importlib.util.spec_from_file_location("check_models", SCRIPT)
        assert spec is not None and spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules["check_models"] = module
        spec.loader.exec_module(module)
    finally:
        sys.path.remove(str(SCRIPT.parent))
    return module


@pytest.mark.timeout(600)
def test_the_quick_runs_come_out_as_they_must() -> None:
    done = subprocess.run([sys.executable, str(SCRIPT), "--quick"], capture_output=True, text=True, check=False)
    if done.returncode == SKIPPED:
        pytest.skip(done.stderr.strip())
    assert done.returncode == 0, done.stdout + done.stderr


def test_runs_that_take_too_long_together_are_wrong(checker: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    used = iter(range(0, 1_000, 100))
    monkeypatch.setattr(checker, "processor_s", lambda: float(next(used)))
    monkeypatch.setattr(checker, "explore", lambda run, seconds_max: checker.read(HOLDS))
    runs = [checker.Run("consensus", f"-DB={number}") for number in range(1, 6)]
    [wrong] = checker.check(runs, 900.0, checker.QUICK_PROCESSOR_S_MAX)
    assert "with consensus -DB=2 the runs have taken 200 s of the processor, and 180 s are the most" in wrong


def test_without_spin_it_says_what_to_install(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, str(SCRIPT)], capture_output=True, text=True, check=False, env={"PATH": str(tmp_path)})
    assert (done.returncode, done.stdout) == (SKIPPED, "") and "apt-get install spin gcc" in done.stderr


def test_every_mutant_and_every_model_has_a_run(checker: ModuleType) -> None:
    flags = {(run.model, flag) for run in checker.RUNS for flag in re.findall(r"-D(MUT_\w+)", run.flags)}
    mutants = {(path.stem, flag) for path in MODELS.glob("*.pml") for flag in re.findall(r"\bMUT_\w+", path.read_text(encoding="utf-8"))}
    assert flags == mutants
    assert {run.model for run in checker.RUNS if not run.is_mutant} == {path.stem for path in MODELS.glob("*.pml")}
    assert len({run.name for run in checker.RUNS}) == len(checker.RUNS)


def test_the_table_of_the_page_has_all_runs(checker: ModuleType) -> None:
    page = (MODELS / "README.md").read_text(encoding="utf-8")
    assert [run.name for run in checker.RUNS if f"| {run.name} |" not in page] == []


@pytest.mark.parametrize(
    ("flags", "text", "ended", "is_right", "words"),
    [
        ("", HOLDS, True, True, "holds"),
        ("", HOLDS, False, False, "CUT OFF"),
        ("", HOLDS + "error: max search depth too small\n", True, False, "CUT OFF"),
        ("", "", True, False, "CUT OFF"),
        ("", FOUND, True, False, "assertion violated ((chosen[c[me]]==0)||(chosen[c[me]]==v))"),
        ("-DMUT_VOTE", FOUND, True, True, "found"),
        ("-DMUT_VOTE", HOLDS, True, False, "NOT FOUND"),
        ("-DMUT_VOTE", HOLDS, False, False, "NOT FOUND, cut off"),
        ("-DMUT_VOTE", "pan:1: invalid end state (at depth 3)\n" + HOLDS, True, False, "invalid end state"),
        (
            "-DMUT_VOTE",
            "pan:1: assertion violated - invalid array index (at depth 4)\n" + HOLDS,
            True,
            False,
            "assertion violated - invalid array index",
        ),
    ],
)
def test_a_run_is_judged(checker: ModuleType, flags: str, text: str, ended: bool, is_right: bool, words: str) -> None:
    assert checker.verdict(checker.Run("consensus", flags), checker.read(text, ended)) == (is_right, words)
