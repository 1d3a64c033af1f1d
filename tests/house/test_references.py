"""If this fails, a comment sends its reader to a page or a part of a page that is not there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from house.sources import ROOT, python_files

NAMED = r"[A-Z](?:[\w'-]| (?!and |says ))*"
REFERENCE = re.compile(rf"specs/(?P<page>[\w.-]*?\.md)(?P<parts>(?:, {NAMED}(?: and {NAMED})*)*)")
"""`specs/12-line.md`, or one or several parts of it: `specs/12-line.md, Holding and Steps`."""
WRAPPED = re.compile(r"\s*\n\s*(?:# )?")
"""Between two lines of a docstring or a comment."""

FILES = list(python_files("src", "cli", "tools", "tests"))


def name(path: Path) -> str:
    return str(path.relative_to(ROOT))


def references(text: str) -> list[tuple[str, list[str]]]:
    """The pages that a file names, each with the parts of it."""
    plain = WRAPPED.sub(" ", text)
    return [(found["page"], [part for part in re.split(r", | and ", found["parts"]) if part]) for found in REFERENCE.finditer(plain)]


def parts_of(page: str) -> list[str]:
    """What a page's headings say, and the words in bold or italics that paragraphs begin with."""
    return re.findall(r"^(?:#+ (?:\d+ )?|\*\*|\*|- \*\*)([^*\n]+)", (ROOT / "specs" / page).read_text(encoding="utf-8"), re.MULTILINE)


def is_there(part: str, page: str) -> bool:
    return any(re.match(rf"{re.escape(part)}(?!\w)", found) for found in parts_of(page))


@pytest.mark.parametrize("path", [path for path in FILES if references(path.read_text(encoding="utf-8"))], ids=name)
def test_what_comments_say_of_the_specifications_is_there(path: Path) -> None:
    for page, parts in references(path.read_text(encoding="utf-8")):
        assert (ROOT / "specs" / page).is_file(), f"no page specs/{page}"
        assert [part for part in parts if not is_there(part, page)] == [], f"specs/{page} has no such part"


def test_references_are_read_as_they_are_written() -> None:
    folder = "specs"
    text = f"""Moved in steps ({folder}/12-line.md, Holding and
    Steps); # more in {folder}/03-wire.md, Encoding,
    # and {folder}/11-peers.md, Gossip, Knocking. {folder}/07-rays.md says why."""
    assert references(text) == [
        ("12-line.md", ["Holding", "Steps"]),
        ("03-wire.md", ["Encoding"]),
        ("11-peers.md", ["Gossip", "Knocking"]),
        ("07-rays.md", []),
    ]
    assert is_there("Gossip", "11-peers.md") and is_there("Knocking", "11-peers.md") and not is_there("Goss", "11-peers.md")
