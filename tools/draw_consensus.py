"""Tables and drawings of the consensus, made from its code: into specs/25-consensus.md and docs/reference/consensus.md.

    python tools/draw_consensus.py

writes both anew. tests/house/test_consensus_pages.py checks that they are up to date.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "src"))

from scenefold.consensus import acceptor, hops, learning, proposer_actions, proposer_guards  # noqa: E402
from scenefold.consensus.acceptor_table import ACCEPTOR  # noqa: E402
from scenefold.consensus.hops_table import HOPS  # noqa: E402
from scenefold.consensus.learning_table import LEARNING  # noqa: E402
from scenefold.consensus.proposer_table import DECIDED, PROPOSER  # noqa: E402
from scenefold.consensus.state import Stage  # noqa: E402
from scenefold.consensus.tables import Row  # noqa: E402

Functions = Mapping[str, Callable[[Any], Any]]

SPECIFICATION = ROOT / "specs" / "25-consensus.md"
PAGE = ROOT / "docs" / "reference" / "consensus.md"
TABLES: dict[str, tuple[tuple[Row, ...], Functions, Functions]] = {
    "acceptor": (ACCEPTOR, acceptor.GUARDS, acceptor.ACTIONS),
    "home": (HOPS, hops.GUARDS, hops.ACTIONS),
    "learning": (LEARNING, learning.GUARDS, learning.ACTIONS),
    "proposer": (PROPOSER, proposer_guards.GUARDS, proposer_actions.ACTIONS),
}
_BUSY = tuple(stage for stage in Stage if stage is not Stage.IDLE)


def words(name: str) -> str:
    """A function's name as it is read."""
    return name.replace("_", " ")


def _stages(row: Row) -> str:
    if row.at == _BUSY:
        return "any but idle"
    return ", ".join(stage.value for stage in row.at)


def _actions(row: Row) -> str:
    reason = "" if row.reason is None else f" ({int(row.reason)})"
    return ", ".join(words(name) for name in row.do) + reason if row.do else "nothing"


def _line(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def table(name: str) -> str:
    """The rows of a table, and what its guards and actions mean, in Markdown."""
    rows, guards, actions = TABLES[name]
    has_stages = any(row.at for row in rows)
    head = ["on", *(["at"] if has_stages else []), "if", "do", *(["then"] if has_stages else [])]
    lines = [_line(head), _line("---" for _ in head)]
    for row in rows:
        given = " and ".join(words(guard) for guard in row.given) or "else"
        then = [] if not has_stages else ["" if row.then is None else row.then.value]
        lines.append(_line([", ".join(row.on), *([_stages(row)] if has_stages else []), given, _actions(row), *then]))
    return "\n".join([*lines, "", *_legend(rows, guards, lambda row: row.given), "", *_legend(rows, actions, lambda row: row.do)])


def _legend(rows: Iterable[Row], functions: Functions, names: Callable[[Row], tuple[str, ...]]) -> list[str]:
    used = dict.fromkeys(name for row in rows for name in names(row))
    return [f"- *{words(name)}*: {' '.join((functions[name].__doc__ or '').split())}" for name in used]


def filled(text: str) -> str:
    """The specification with its tables as the code has them."""
    for name in TABLES:
        pattern = rf"(<!-- table: {name} -->\n).*?(<!-- end -->)"
        made = f"\n{table(name)}\n\n"
        text, count = re.subn(pattern, lambda found, made=made: found[1] + made + found[2], text, flags=re.DOTALL)  # type: ignore[misc]
        assert count == 1, f"no place for the table {name}"
    return text


def diagram() -> str:
    """The stages of a proposal, and what leads from one to another, as a Mermaid state diagram."""
    ways: dict[tuple[Stage, Stage], list[str]] = {}
    for row in PROPOSER:
        for stage in row.at:
            if row.then is not None and row.on != (DECIDED,):
                given = " and ".join(words(guard) for guard in row.given)
                ways.setdefault((stage, row.then), []).append("/".join(row.on) + (f", {given}" if given else ""))
    lines = ["stateDiagram-v2", "    direction LR", f"    [*] --> {Stage.IDLE.value}"]
    for (before, after), labels in ways.items():
        lines.append(f"    {before.value} --> {after.value}: {'<br/>'.join(dict.fromkeys(labels))}")
    lines += [f"    {stage.value} --> {Stage.IDLE.value}: {DECIDED}" for stage in _BUSY]
    return "\n".join(lines)


def flow(name: str) -> str:
    """The rows of a table without stages, one below the other, as a Mermaid flowchart: the first that fits is taken."""
    lines, before = ["flowchart TD"], ""
    for number, row in enumerate(TABLES[name][0]):
        given = f"{', '.join(row.on)}: " + (" and ".join(words(guard) for guard in row.given) or "else")
        lines += [f'    q{number}{{{{"{given}"}}}} -- yes --> a{number}["{_actions(row)}"]']
        if before:
            lines.append(f"    {before} -- no --> q{number}")
        before = f"q{number}"
    return "\n".join(lines)


def page() -> str:
    """The page of the documentation."""
    return "\n".join(
        [
            "# Consensus, drawn",
            "",
            "How the nodes that decide a log agree on its next entry. Made by `tools/draw_consensus.py` from the tables in `scenefold.consensus`;",
            "what the words mean, and why it is right, is in `specs/25-consensus.md`.",
            "",
            "## A proposal, at the node that makes it",
            "",
            "```mermaid",
            diagram(),
            "```",
            "",
            "## A proposal, at a node that it visits",
            "",
            "```mermaid",
            flow("acceptor"),
            "```",
            "",
            "## An answer, on its way home",
            "",
            "```mermaid",
            flow("home"),
            "```",
            "",
            "## What is decided, and who asks for it",
            "",
            "```mermaid",
            flow("learning"),
            "```",
            "",
        ]
    )


def main() -> None:
    SPECIFICATION.write_text(filled(SPECIFICATION.read_text(encoding="utf-8")), encoding="utf-8")
    PAGE.write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main()
