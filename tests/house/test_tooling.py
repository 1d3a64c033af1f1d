"""If this fails, a fresh clone does not install, build or test as README.md says."""

from __future__ import annotations

import re
import tomllib
from importlib import metadata

import pytest

from house.sources import ROOT, module_of, python_files

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PINNED = dict(
    line.split("==") for line in (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines() if line and not line.startswith("#")
)


def plain(name: str) -> str:
    """A package's name as registries compare it, without extras, versions and markers."""
    return re.sub(r"[-_.]+", "-", re.split(r"[\s\[;<>=!~]", name.strip())[0]).lower()


def required() -> set[str]:
    """Every package that the project, its extras and its build need, through all levels that are installed here."""
    project = PROJECT["project"]
    extras = [name for names in project["optional-dependencies"].values() for name in names]
    waiting, seen = {plain(name) for name in [*project["dependencies"], *extras, *PROJECT["build-system"]["requires"]]}, set[str]()
    while waiting:
        package = waiting.pop()
        seen.add(package)
        try:
            needs = metadata.requires(package) or []
        except metadata.PackageNotFoundError:  # an extra that is not installed: its own name must be pinned, at least
            continue
        waiting |= {plain(need) for need in needs if ";" not in need} - seen
    return seen


def test_every_dependency_is_pinned() -> None:
    assert required() - {plain(name) for name in PINNED} == set(), "run tools/pin.py"


def test_pins_are_names_and_versions_only() -> None:
    for line in (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines():
        assert line.startswith("#") or re.fullmatch(r"[A-Za-z0-9._-]+==[A-Za-z0-9.+!]+", line), line


@pytest.mark.parametrize("target", ["help", "install", "demo", "test", "test-render", "lint", "bench", "docs", "clean"])
def test_make_has(target: str) -> None:
    assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)


def test_ci_runs_what_people_run() -> None:
    assert "make test" in (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert (ROOT / ".ci" / "run").stat().st_mode & 0o111, "executable"
    assert "run: .ci/run" in (ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8")


def test_every_dependency_is_explained() -> None:
    page = (ROOT / "docs" / "dependencies.md").read_text(encoding="utf-8").lower()
    named = [
        *PROJECT["project"]["dependencies"],
        *(name for names in PROJECT["project"]["optional-dependencies"].values() for name in names),
    ]
    assert [name for name in named if plain(name) not in page.replace("_", "-")] == []


def test_mypy_knows_every_kernels_module() -> None:
    kernels = sorted(module_of(path) for path in python_files("src") if "kernels" in path.name)
    mypy = PROJECT["tool"]["mypy"]
    assert sorted(mypy["untyped_calls_exclude"]) == kernels, "put it into both lists in pyproject.toml"
    assert any(sorted(override["module"]) == kernels for override in mypy["overrides"]), "put it into both lists in pyproject.toml"
