"""If this fails, a newcomer's first `make` ends in a traceback, in the wrong Python, or in a stale .venv.

Fake Pythons are small shell scripts that answer the probe; no environment is made and nothing is downloaded.
"""

from __future__ import annotations

import importlib.util
import json
import os
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

import bootstrap
import pytest

Fake = Callable[..., Path]


@pytest.fixture
def fake(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Fake:
    """fake("python3", "3.9.1") puts such a Python on an otherwise empty PATH."""
    folder = tmp_path / "bin"
    folder.mkdir()
    monkeypatch.setenv("PATH", str(folder))

    def make(name: str, version: str, *, can_make_venv: bool = True, text: str | None = None) -> Path:
        answer = json.dumps([[int(part) for part in version.split(".")], can_make_venv]) if version else ""
        path = folder / name
        path.write_text(text or f"#!/bin/sh\necho '{answer}'\n")
        path.chmod(0o755)
        return path

    return make


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    """A folder with what bootstrap looks at, and a .venv that seems complete."""
    root = tmp_path / "clone"
    (root / ".venv" / "bin").mkdir(parents=True)
    (root / "pyproject.toml").write_text("[project]\n")
    (root / "constraints.txt").write_text("trio==1\n")
    (root / ".venv" / "pyvenv.cfg").write_text("home = /somewhere\n")
    (root / ".venv" / "bin" / "python").symlink_to(sys.executable)
    (root / ".venv" / "bin" / "pip").write_text(f"#!{root}/.venv/bin/python\n")
    return root


def stamp(root: Path, *extras: str) -> None:
    (root / ".venv" / "scenefold-stamp.json").write_text(json.dumps(bootstrap.stamp_for(str(root), list(extras))))


def test_takes_python3_when_it_serves(fake: Fake) -> None:
    fake("python3.12", "3.12.1")
    wanted = fake("python3", "3.11.7")
    assert bootstrap.choose_python("").command == str(wanted)


def test_passes_over_old_ones_stubs_and_ones_without_venv(fake: Fake) -> None:
    fake("python3", "3.9.18")
    fake("python3.11", "", text="#!/bin/sh\necho 'command not found' >&2\nexit 127\n")
    fake("python3.12", "3.12.1", can_make_venv=False)
    wanted = fake("python3.13", "3.13.0")
    assert bootstrap.choose_python("").command == str(wanted)


def test_a_named_python_is_used_or_refused_but_never_replaced(fake: Fake) -> None:
    fake("python3", "3.12.1")
    old = fake("mine", "3.8.1")
    with pytest.raises(bootstrap.Problem, match=r"3\.11 or newer, but .*mine is 3\.8\.1: install"):
        bootstrap.choose_python(str(old))
    with pytest.raises(bootstrap.Problem, match="cannot run absent: install"):
        bootstrap.choose_python("absent")


def test_says_what_is_missing(fake: Fake) -> None:
    with pytest.raises(bootstrap.Problem, match="cannot run python3: install"):
        bootstrap.choose_python("")
    fake("python3", "3.6.15")
    with pytest.raises(bootstrap.Problem, match=r"needs Python 3\.11 or newer, but .*python3 is 3\.6\.15"):
        bootstrap.choose_python("")
    fake("python3", "3.11.2", can_make_venv=False)
    with pytest.raises(bootstrap.Problem, match=r"lacks the modules venv and ensurepip.*apt install python3\.11-venv"):
        bootstrap.choose_python("")


def test_ready_only_with_a_stamp_for_these_extras(clone: Path) -> None:
    assert not bootstrap.is_ready(str(clone), "", [])
    stamp(clone, "dev")
    assert bootstrap.is_ready(str(clone), "", [])
    assert bootstrap.is_ready(str(clone), "", ["dev"])
    assert not bootstrap.is_ready(str(clone), "", ["dev", "docs"])


def test_not_ready_for_another_python(clone: Path, fake: Fake) -> None:
    stamp(clone)
    here = ".".join(map(str, sys.version_info[:3]))
    assert bootstrap.is_ready(str(clone), str(fake("same", here)), [])
    assert not bootstrap.is_ready(str(clone), str(fake("other", "3.99.0")), [])


@pytest.mark.parametrize("name", ["pyproject.toml", "constraints.txt"])
def test_not_ready_after_the_requirements_changed(clone: Path, name: str) -> None:
    stamp(clone)
    (clone / name).write_text("# changed\n")
    assert not bootstrap.is_ready(str(clone), "", [])


def test_not_ready_after_the_clone_moved_or_python_went_away(clone: Path) -> None:
    stamp(clone)
    moved = clone.rename(clone.with_name("moved"))
    assert not bootstrap.is_ready(str(moved), "", [])
    assert bootstrap.why_unusable(str(moved)) == "the folder was moved"
    moved.rename(clone)
    assert bootstrap.why_unusable(str(clone)) == ""
    (clone / ".venv" / "bin" / "python").unlink()
    (clone / ".venv" / "bin" / "python").symlink_to("/nowhere/python")
    assert not bootstrap.is_ready(str(clone), "", [])
    assert bootstrap.why_unusable(str(clone)) == "its Python no longer runs"


def test_a_damaged_stamp_is_no_stamp(clone: Path) -> None:
    for text in ("", "[]", "{", '{"extras": 3}'):
        (clone / ".venv" / "scenefold-stamp.json").write_text(text)
        assert not bootstrap.is_ready(str(clone), "", [])


def test_never_removes_a_folder_that_is_no_environment(clone: Path) -> None:
    (clone / ".venv" / "pyvenv.cfg").unlink()
    with pytest.raises(bootstrap.Problem, match="no virtual environment: move it away"):
        bootstrap.remove_venv(str(clone), "test")
    assert (clone / ".venv" / "bin" / "pip").exists()


PIP_SAYS = [
    (
        "WARNING: Retrying (Retry(total=0)) after connection broken by 'NewConnectionError('[Errno 111] Connection refused')': /simple/x/\n"
        "ERROR: Cannot install x because these package versions have conflicting dependencies.\n"
        "ERROR: ResolutionImpossible: for help visit a page",
        "cannot reach the package registry",
    ),
    ("ERROR: Could not find a version that satisfies x\nERROR: No matching distribution found for x==9", "has no x==9 that suits"),
    ("ERROR: Could not install packages due to an OSError: [Errno 28] No space left on device", "no space left on the device"),
    ("noise\nerror: metadata-generation-failed\n\n", "pip failed: error: metadata-generation-failed"),
    ("", "pip failed: no output"),
]


@pytest.mark.parametrize(("output", "line"), PIP_SAYS)
def test_pip_in_one_line(output: str, line: str) -> None:
    explained = bootstrap.explain_pip(output, "the.log")
    assert line in explained
    assert "\n" not in explained


def test_no_password_in_the_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PIP_INDEX_URL", "http://me:secret@127.0.0.1:9/simple")
    assert bootstrap.registry_named() == " at http://127.0.0.1:9/simple"


def test_problems_are_one_line_on_standard_output(
    clone: Path, fake: Fake, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert os.environ["PATH"]
    monkeypatch.setattr(bootstrap, "why_unusable", lambda _root: "a test")
    fake("python3", "3.7.0")
    assert bootstrap.main(["--root", str(clone), "--extras", "dev"]) == 1
    output = capsys.readouterr()
    assert output.out.count("\n") == 1
    assert "newer, but" in output.out
    assert (clone / ".venv" / "pyvenv.cfg").exists(), "the old environment stays until a new one can be made"
    stamp(clone, "dev")
    assert bootstrap.main(["--root", str(clone), "--extras", "dev"]) == 0
    assert capsys.readouterr().out == "ready\n"


def test_every_build_tool_is_pinned() -> None:
    pinned = {line.split("==")[0] for line in (Path(bootstrap.ROOT) / "constraints.txt").read_text().splitlines()}
    requires = tomllib.loads((Path(bootstrap.ROOT) / "pyproject.toml").read_text())["build-system"]["requires"]
    assert set(bootstrap.BUILD_TOOLS) <= pinned
    assert set(requires) <= set(bootstrap.BUILD_TOOLS)


def test_this_environment_builds_requirements_that_have_no_wheel() -> None:
    # Nothing is isolated while make installs: what the environment lacks here, a machine without pip's cache lacks too.
    assert importlib.util.find_spec("setuptools.command.bdist_wheel")
