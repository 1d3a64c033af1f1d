"""If this fails, the page about the fuzzer tells of fewer things than strangers may send, so nobody knows what a run has covered."""

from __future__ import annotations

import re
from pathlib import Path

from fuzz.targets import TARGETS
from scenefold.wire.table import ROWS

PAGE = Path(__file__).resolve().parents[2] / "docs" / "how-to" / "fuzz.md"


def feeds() -> str:
    """The part of the page that says what is fed today; runs of long ago had less."""
    found = re.search(r"^## What it feeds\n(.*?)^## ", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    assert found is not None
    return found[1]


def test_the_page_counts_the_packets_and_kinds_that_there_are() -> None:
    assert f"All {len(ROWS)} packets, and {len(TARGETS)} kinds of inputs" in feeds()


def test_the_page_names_every_kind_once() -> None:
    first_cells = [line.split("|")[1] for line in feeds().splitlines() if line.startswith("| `")]
    assert sorted(re.findall(r"`([^`]+)`", " ".join(first_cells))) == sorted(TARGETS)
