"""If this fails, somebody who builds from specs/03-wire.md builds something else than we did."""

from __future__ import annotations

import re
from pathlib import Path

from scenefold.base.reasons import RejectReason
from scenefold.wire.log_entries import LOG_ENTRY
from scenefold.wire.table import RESERVED, ROWS, STRUCTS

SPEC = (Path(__file__).resolve().parents[3] / "specs" / "03-wire.md").read_text(encoding="utf-8")


def cells(pattern: str) -> list[list[str]]:
    """Rows of the spec's tables whose first cell fits."""
    rows = [[cell.strip() for cell in line.strip().strip("|").split("|")] for line in SPEC.replace("\\|", "¦").splitlines()]
    return [[cell.replace("¦", "|") for cell in row] for row in rows if len(row) > 1 and re.fullmatch(pattern, row[0])]


def fields(described: tuple[tuple[str, object], ...]) -> str:
    return "; ".join(f"{name} {kind.text}" for name, kind in described) or "—"  # type: ignore[attr-defined]


def test_packets() -> None:
    laws = {number: f" (and {row.law})" if row.law else "" for number, row in ROWS.items()}
    assert cells(r"\d+") == [
        [str(number), f"{row.name} (since {row.since})" if row.since > 1 else row.name, str(row.carrier), fields(row.fields) + laws[number]]
        for number, row in sorted(ROWS.items())
    ]


def test_structs() -> None:
    names = {struct.name for struct in STRUCTS}
    laws = {struct.name: f" (and {struct.law})" if struct.law else "" for struct in STRUCTS}
    assert cells("|".join(names)) == [[struct.name, fields(struct.fields) + laws[struct.name]] for struct in STRUCTS]


def test_log_entries() -> None:
    assert cells(r"entry \d+") == [
        [f"entry {number}", kind.name, fields(kind.fields) + (f" (and {kind.law})" if kind.law else "")]
        for number, kind in LOG_ENTRY.structs.items()
    ]


def test_reserved_numbers() -> None:
    assert cells(r"№ \d+") == [[f"№ {number}", name] for number, name in sorted(RESERVED.items())]


def test_reasons() -> None:
    assert cells(r"reason \d+") == [[f"reason {reason}", reason.name] for reason in RejectReason]
