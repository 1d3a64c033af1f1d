"""If this fails, a file hides a second idea, does not say what it is for, or says what does not belong here."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from house.sources import ROOT, python_files, text_files

LINES_MAX = 500
# Put together here, so that this file may be searched too.
REGISTRIES = re.compile(
    "|".join(re.escape(a + b) for a, b in [("pypi", ".org"), ("python", "hosted."), ("npmjs", ".com"), ("anaconda", ".org")])
)
UNFINISHED = re.compile(r"\b(" + "|".join(["TO" + "DO", "FIX" + "ME", "X" + "XX", "HA" + "CK"]) + r")\b")
ONE_MACHINE = re.compile(r"(?<![\w.$}/-])/(" + "|".join(["wo" + "rk", "ro" + "ot"]) + ")/")

PYTHON = list(python_files("src", "cli", "tests", "tools", "benchmarks"))


def name(path: Path) -> str:
    return str(path.relative_to(ROOT))


@pytest.mark.parametrize("path", PYTHON, ids=name)
def test_python_file(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert text.count("\n") <= LINES_MAX, "find the second idea in it"
    is_empty_marker = path.name == "__init__.py" and not text.strip() and "tests" in path.parts
    assert is_empty_marker or ast.get_docstring(ast.parse(text)), "a module opens with what it is for"


@pytest.mark.parametrize(
    ("pattern", "why"),
    [
        (REGISTRIES, "where packages come from is the reader's pip configuration"),
        (UNFINISHED, "write it down where others find it, or do it"),
        (ONE_MACHINE, "a path of one developer's machine"),
    ],
    ids=["registries", "unfinished", "paths"],
)
def test_no_file_holds(pattern: re.Pattern[str], why: str) -> None:
    found = [
        f"{name(path)}:{number}: {line.strip()[:100]}"
        for path in text_files()
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if pattern.search(line)
    ]
    assert found == [], why


@pytest.mark.parametrize("path", [path for path in text_files() if path.suffix == ".md"], ids=name)
def test_links_lead_somewhere(path: Path) -> None:
    text = re.sub(r"```.*?```|`[^`]*`", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
    targets = [target.split("#")[0] for target in re.findall(r"(?<!!)\[[^\]]+\]\(([^)\s]+)\)", text) if "://" not in target]
    assert [target for target in targets if target and not (path.parent / target).exists()] == []
