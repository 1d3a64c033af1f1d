"""Pictures of tables as SVG, of what there is in every browser: for tools/draw_consensus.py.

Everything is placed by counting letters, which are all of one width; so nothing lies on anything else, and the same table is the same picture.
The ground is a part of the picture: it can be read on a light page and on a dark one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from xml.sax.saxutils import escape

LETTER_W, LETTER_PX, LINE_H = 7.3, 12, 16
"""A monospaced letter of 12 px has 7.2 at most."""
PAD, EDGE = 10, 16
LANE_W, BOX_H, HEAD_PX = 168, 32, 7
YES_W, STEP_GAP = 56, 22
INK, FAINT, FILL, GROUND = "#1f2933", "#9aa5b1", "#e4ecf4", "#ffffff"


@dataclass(frozen=True)
class Way:
    """From some lanes to another one, for reasons, one a line."""

    sources: tuple[str, ...]
    target: str
    labels: tuple[str, ...]


@dataclass(frozen=True)
class Step:
    """A question, and what is done if the answer is yes; else the next one is asked."""

    question: str
    answer: str


def lanes(title: str, names: Sequence[str], ways: Sequence[Way]) -> str:
    """A lane for each name, and a row for each way: an arrow from the lanes that have a dot in it. The first lane is where all begins."""
    middle = {name: EDGE + LANE_W // 2 + LANE_W * place for place, name in enumerate(names)}
    width, top = 2 * EDGE + LANE_W * len(names), EDGE + BOX_H
    parts, gaps, y = list[str](), list[tuple[float, float, float, float]](), top + 14.0
    for way in ways:
        ends = [middle[name] for name in way.sources]
        goal = middle[way.target]
        across = max(map(len, way.labels)) * LETTER_W
        left = (min(*ends, goal) + max(*ends, goal) - across) / 2
        left = max(EDGE, min(left, width - EDGE - across))
        below = y + LINE_H * len(way.labels)
        gaps.append((left - 4, left + across + 4, y, below))
        parts += [_text(left + across / 2, y + LINE_H * (number + 0.75), label) for number, label in enumerate(way.labels)]
        at = below + 8
        # Lanes on one side of the goal share an arrow.
        parts += [_arrow(far, at, goal, at) for far in (min(ends), max(ends)) if far == min(ends) < goal or far == max(ends) > goal]
        parts += [f'<circle cx="{_n(end)}" cy="{_n(at)}" r="4" fill="{INK}"/>' for end in ends]
        y = at + 20
    lines = [_lane(x, top, y, [gap for gap in gaps if gap[0] <= x <= gap[1]]) for x in middle.values()]
    heads = [_box(x - LANE_W / 2 + 14, edge, LANE_W - 28, BOX_H, [name]) for edge in (EDGE, y) for name, x in middle.items()]
    return _picture(title, width, y + BOX_H + EDGE, [*lines, *heads, *parts])


def steps(title: str, rows: Sequence[Step]) -> str:
    """The steps one below the other."""
    asks = max(len(row.question) for row in rows) * LETTER_W + 2 * PAD
    does = max(len(row.answer) for row in rows) * LETTER_W + 2 * PAD
    parts = list[str]()
    for number, row in enumerate(rows):
        y, right = EDGE + number * (BOX_H + STEP_GAP), EDGE + asks
        middle = y + BOX_H / 2
        parts += [
            _box(EDGE, y, asks, BOX_H, [row.question], round_px=BOX_H // 2),
            _arrow(right, middle, right + YES_W, middle),
            _text(right + YES_W / 2 - 4, middle - 4, "yes"),
            _box(right + YES_W, y, does, BOX_H, [row.answer]),
        ]
        if number + 1 < len(rows):
            parts += [
                _arrow(EDGE + asks / 2, y + BOX_H, EDGE + asks / 2, y + BOX_H + STEP_GAP),
                _text(EDGE + asks / 2 + 16, y + BOX_H + STEP_GAP / 2 + 4, "no"),
            ]
    return _picture(title, 2 * EDGE + asks + YES_W + does, 2 * EDGE + len(rows) * (BOX_H + STEP_GAP) - STEP_GAP, parts)


def _n(number: float) -> str:
    return f"{number:.1f}".removesuffix(".0")


def _text(x: float, y: float, text: str) -> str:
    return f'<text x="{_n(x)}" y="{_n(y)}">{escape(text)}</text>'


def _box(x: float, y: float, width: float, height: float, lines: Sequence[str], round_px: int = 5) -> str:
    shape = f'<rect x="{_n(x)}" y="{_n(y)}" width="{_n(width)}" height="{_n(height)}" rx="{round_px}" fill="{FILL}" stroke="{INK}"/>'
    top = y + (height - LINE_H * len(lines)) / 2
    return shape + "".join(_text(x + width / 2, top + LINE_H * (number + 0.75), line) for number, line in enumerate(lines))


def _arrow(x: float, y: float, to_x: float, to_y: float) -> str:
    """Along one axis, with a head."""
    if y == to_y:
        back = to_x - HEAD_PX if to_x > x else to_x + HEAD_PX
        head = f"{_n(to_x)},{_n(y)} {_n(back)},{_n(y - 4)} {_n(back)},{_n(y + 4)}"
        return f'<path d="M{_n(x)} {_n(y)}H{_n(back)}" stroke="{INK}"/><polygon points="{head}" fill="{INK}"/>'
    back = to_y - HEAD_PX
    head = f"{_n(x)},{_n(to_y)} {_n(x - 4)},{_n(back)} {_n(x + 4)},{_n(back)}"
    return f'<path d="M{_n(x)} {_n(y)}V{_n(back)}" stroke="{INK}"/><polygon points="{head}" fill="{INK}"/>'


def _lane(x: float, top: float, bottom: float, gaps: Sequence[tuple[float, float, float, float]]) -> str:
    """A line that words are written between."""
    path, y = "", top
    for _, _, begins, ends in gaps:
        path += f"M{_n(x)} {_n(y)}V{_n(begins)}"
        y = ends
    return f'<path d="{path}M{_n(x)} {_n(y)}V{_n(bottom)}" stroke="{FAINT}"/>'


def _picture(title: str, width: float, height: float, parts: Sequence[str]) -> str:
    size = f'width="{_n(width)}" height="{_n(height)}"'
    family = "ui-monospace, Menlo, Consolas, 'DejaVu Sans Mono', monospace"
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" {size} viewBox="0 0 {_n(width)} {_n(height)}" role="img" aria-labelledby="title">',
            f'<title id="title">{escape(title)}</title>',
            f'<rect {size} rx="8" fill="{GROUND}"/>',
            f'<g font-family="{family}" font-size="{LETTER_PX}" text-anchor="middle" fill="{INK}" stroke-width="1.2">',
            *parts,
            "</g>",
            "</svg>",
            "",
        ]
    )
