"""If this fails, a room knows one above or beside it, or a new room stands on no floor.

The floors are in pyproject.toml, as docs/architecture.md draws them.
"""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

from house.sources import ROOT


def test_imports_go_downward() -> None:
    lint_imports = Path(sys.executable).with_name("lint-imports")
    done = subprocess.run([lint_imports, "--no-cache"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_every_room_stands_on_a_floor() -> None:
    contract = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]["contracts"][0]
    floors = " ".join(contract["layers"]).replace("(", " ").replace(")", " ").split()
    rooms = {f"scenefold.{path.parent.name}" for path in (ROOT / "src" / "scenefold").glob("*/__init__.py")}
    # scenefold.sync is the public surface without async, above the rooms as scenefold itself is.
    assert rooms - {"scenefold.sync"} <= set(floors)
