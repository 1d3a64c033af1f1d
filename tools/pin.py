"""Writes constraints.txt: the exact versions of everything that scenefold and all its extras install.

    .venv/bin/python tools/pin.py             add what pyproject.toml newly names, keep every other version
    .venv/bin/python tools/pin.py --upgrade   the newest versions of everything; run all tests afterwards

A fresh environment is filled and frozen, so that nothing a developer happens to have installed gets in. The file
holds names and versions alone: where packages come from is the reader's pip configuration.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import tomllib
import venv
from pathlib import Path

from bootstrap import BUILD_TOOLS

ROOT = Path(__file__).resolve().parent.parent
HEAD = """\
# The exact versions that scenefold is tested with: runtime, dev, docs and all extras. Written by tools/pin.py.
# Names and versions only; `make` installs with them, and so does CI.
"""


def wanted_names() -> list[str]:
    """Every requirement that pyproject.toml names, and what builds them from source."""
    described = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    project = described["project"]
    extras = [name for names in project["optional-dependencies"].values() for name in names]
    return [*BUILD_TOOLS, *project["dependencies"], *extras]


def main() -> int:
    """Fill, freeze, write; pip's own exit status if it fails."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--upgrade", action="store_true", help="forget the present versions")
    options = parser.parse_args()
    constraints = ROOT / "constraints.txt"
    held = [] if options.upgrade or not constraints.exists() else ["-c", str(constraints)]
    with tempfile.TemporaryDirectory(prefix="scenefold-pin-") as folder:
        venv.create(folder, with_pip=True)
        pip = [f"{folder}/bin/python", "-m", "pip", "--disable-pip-version-check"]
        installed = subprocess.run([*pip, "install", "--quiet", *held, *wanted_names()], check=False)
        if installed.returncode:
            return installed.returncode
        # All of it: setuptools, which builds what has no wheel, is left out otherwise.
        frozen = subprocess.run([*pip, "freeze", "--all", "--exclude", "pip"], check=True, capture_output=True, text=True).stdout
    constraints.write_text(HEAD + frozen, encoding="utf-8")
    print(f"{constraints.name}: {len(frozen.splitlines())} packages")
    return 0


if __name__ == "__main__":
    sys.exit(main())
