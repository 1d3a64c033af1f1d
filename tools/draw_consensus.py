"""Tables and drawings of the consensus, made from its code: into specs/25-consensus.md, docs/reference/consensus.md and pictures beside that.

    python tools/draw_consensus.py

writes all of them anew. tests/house/test_consensus_pages.py checks that they are up to date.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "src"))

from consensus_pictures import Step, Way, lanes, steps  # noqa: E402

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


@dataclass(frozen=True)
class Drawing:
    """A part of the page: its head, how the picture is read, and its title for who does not see it."""

    file: Path
    head: str
    how: str
    title: str


_FIRST_FITS = "From the top, the first question whose answer is yes says what is done."
DRAWINGS = {
    name: Drawing(PAGE.with_name(f"consensus-{name}.svg"), head, how, title)
    for name, head, how, title in (
        (
            "proposer",
            "A proposal, at the node that makes it",
            "Each column is a stage. A row is what leads from the stages that have a dot in it to the one that its arrow points to; 8 and 9 are "
            "packets. Which of several conditions is looked at first, and what changes no stage, is in the table alone.",
            "The stages of a proposal, from idle to resting, and what leads from one to another: the rows of the table below that name a next stage",
        ),
        (
            "acceptor",
            "A proposal, at a node that it visits",
            _FIRST_FITS,
            "What a node does with a proposal of another one, as questions one below the other: the rows of the table below",
        ),
        (
            "home",
            "An answer, on its way home",
            _FIRST_FITS,
            "What a node does with an answer on its way home, as questions one below the other: the rows of the table below",
        ),
        (
            "learning",
            "What is decided, and who asks for it",
            _FIRST_FITS,
            "What a node does with what others decided, or ask for, as questions one below the other: the rows of the table below",
        ),
    )
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


def proposal() -> str:
    """The stages of a proposal, and what leads from one to another."""
    ways: dict[tuple[tuple[Stage, ...], Stage], list[str]] = {}
    for place, row in enumerate(PROPOSER):
        if row.then is not None and row.on != (DECIDED,):
            above = (other for other in PROPOSER[:place] if {*other.on} & {*row.on} and {*other.at} & {*row.at})
            given = " and ".join(words(guard) for guard in row.given) or ("else" if any(above) else "")
            ways.setdefault((row.at, row.then), []).append("/".join(row.on) + (f", {given}" if given else ""))
    drawn = [Way(tuple(stage.value for stage in at), then.value, tuple(labels)) for (at, then), labels in ways.items()]
    drawn.append(Way(tuple(stage.value for stage in _BUSY), Stage.IDLE.value, (DECIDED,)))
    return lanes(DRAWINGS["proposer"].title, [stage.value for stage in Stage], drawn)


def flow(name: str) -> str:
    """The rows of a table without stages, one below the other: the first that fits is taken."""
    rows = (
        Step(f"{', '.join(row.on)}: " + (" and ".join(words(guard) for guard in row.given) or "else"), _actions(row))
        for row in TABLES[name][0]
    )
    return steps(DRAWINGS[name].title, list(rows))


def picture(name: str) -> str:
    """The picture of a table, as SVG."""
    return proposal() if name == "proposer" else flow(name)


def page() -> str:
    """The page of the documentation."""
    lines = [
        "# Consensus, drawn",
        "",
        "How the nodes that decide a log agree on its next entry. Made by `tools/draw_consensus.py` from the tables in `scenefold.consensus`;",
        "why it is right is in `specs/25-consensus.md`.",
    ]
    for name, drawing in DRAWINGS.items():
        lines += ["", f"## {drawing.head}", "", drawing.how, "", f"![{drawing.title}]({drawing.file.name})", "", table(name)]
    return "\n".join([*lines, ""])


def main() -> None:
    SPECIFICATION.write_text(filled(SPECIFICATION.read_text(encoding="utf-8")), encoding="utf-8")
    PAGE.write_text(page(), encoding="utf-8")
    for name, drawing in DRAWINGS.items():
        drawing.file.write_text(picture(name), encoding="utf-8")


if __name__ == "__main__":
    main()
