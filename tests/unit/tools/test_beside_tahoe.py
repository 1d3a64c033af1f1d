"""If this fails, whoever cannot have Tahoe-LAFS is not told why, or learns it from a traceback."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

SCRIPT = Path(__file__).parents[3] / "benchmarks" / "beside_tahoe.py"
SKIPPED = 77


def said(*options: str) -> str:
    done = subprocess.run([sys.executable, str(SCRIPT), *options], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout) == (SKIPPED, ""), done.stderr
    return done.stderr


def test_a_tahoe_that_does_not_work_is_a_reason_to_skip(tmp_path: Path) -> None:
    program = tmp_path / "bin" / "tahoe"
    program.parent.mkdir()
    program.write_text("#!/bin/sh\necho 'ERROR: no such thing on this machine' >&2\nexit 1\n")
    program.chmod(0o755)
    words = said("--tahoe", str(tmp_path), "--scenectl", sys.executable)
    assert words.startswith("skipped: ") and "no such thing on this machine" in words and words.count("\n") == 1


def test_without_scenectl_there_is_nothing_to_measure(tmp_path: Path) -> None:
    assert "--scenectl" in said("--scenectl", str(tmp_path / "scenectl"))
