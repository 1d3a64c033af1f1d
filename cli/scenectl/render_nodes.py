"""The nodes of a render while it goes on: a table that stays in place, for `scenectl render watch` on a terminal."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, NamedTuple

from scenectl.output import size_text, time_text
from scenefold.base.printable import printable
from scenefold.base.rays import RAY_BYTES

if TYPE_CHECKING:
    from collections.abc import Callable

    from rich.console import RenderableType

    from scenefold.render.reports import NodeStand, Stand

INTERVAL_S = 1.0
"""The rates are over at least so long."""
TITLES = ("node", "of the scene", "of the work", "visits/s", "busy", "waiting", "memory", "passed on/s")


class Moment(NamedTuple):
    """A look."""

    at: float
    """In seconds, by any clock."""
    stand: Stand
    nodes: Sequence[NodeStand]


@contextmanager
def live_table() -> Iterator[Callable[[Stand, list[NodeStand]], None] | None]:
    """What is to be told of each look; None where standard error is no terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.live import Live

    before: Moment | None = None
    with Live(console=Console(file=sys.stderr), auto_refresh=False, transient=True) as live:

        def seen(stand: Stand, nodes: list[NodeStand]) -> None:
            nonlocal before
            now = Moment(time.monotonic(), stand, nodes)
            if before is None or before.stand.phase != stand.phase:
                before = now
            elif now.at - before.at >= INTERVAL_S:
                live.update(_screen(before, now), refresh=True)
                before = now

        yield seen


def rows_of(before: Moment, now: Moment) -> list[tuple[str, ...]]:
    """The table's cells, a row for each node."""
    seconds = max(now.at - before.at, 1e-9)
    former = {node.address: node for node in before.nodes}
    away = [address for address in now.stand.lost if now.stand.lost.count(address) > now.stand.back.count(address)]
    # Each pool has all of it.
    triangles = max(sum(node.triangles for node in now.nodes if node.address not in away) / now.stand.pools, 1)
    casts = max(sum(node.casts for node in now.nodes), 1)
    rows: list[tuple[str, ...]] = []
    for node in now.nodes:
        was = former.get(node.address, node)
        # One that was lost and is back counts from nothing.
        visits, sent, busy = (max(0.0, more) for more in (node.casts - was.casts, node.rays_sent - was.rays_sent, node.busy_s - was.busy_s))
        rows.append(
            (
                node.address,
                f"{node.triangles / triangles:.0%}",
                f"{node.casts / casts:.0%}",
                f"{visits / seconds:,.0f}",
                f"{busy / seconds:.2f}",
                f"{node.waiting:,}",
                size_text(node.memory) if node.memory else "",
                size_text(sent * RAY_BYTES / seconds),
            )
        )
    return rows


def line_of(before: Moment, now: Moment) -> str:
    """How far it is."""
    closed, passes = now.stand.closed, now.stand.passes
    if now.stand.phase != "rendering":
        return now.stand.phase
    rate = (closed - before.stand.closed) / max(now.at - before.at, 1e-9)
    left = f", {time_text((passes - closed) / rate)} left" if rate > 0 else ""
    return f"{closed:,} of {passes:,} passes{left}"


def _screen(before: Moment, now: Moment) -> RenderableType:
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    rows = Table(box=None, pad_edge=False)
    for index, title in enumerate(TITLES):
        rows.add_column(title, justify="right" if index else "left")
    for row in rows_of(before, now):
        rows.add_row(*(Text(printable(cell)) for cell in row))
    return Group(rows, Text(printable(line_of(before, now))))
