"""`scenectl cluster top`: the cluster again and again, as a table that stays in place on a terminal and as lines elsewhere."""

from __future__ import annotations

import sys
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, Any

from scenectl.cluster_text import RATE_TITLES, movement_text, rate_rows, strangers_text
from scenectl.output import Output, emit_event, size_text, table
from scenefold.base.printable import printable

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.live import Live

    from scenefold.client import Cluster, ClusterStatus, Movement, Rate

INTERVAL_S = 1.0
"""Between two looks. The rates are over the time that really passed."""


async def watch(cluster: Cluster, output: Output, *, once: bool) -> None:
    """Look once a second until cancelled; `once`: show one comparison of two looks."""
    from scenefold.client import Watch, movements, rates

    clock, looking = cluster.calls.world.clock, Watch(cluster)
    looked_at = clock.now()
    before = await looking.look()
    with _terminal(output, once) as live:
        while True:
            # From beginning to beginning: a look takes most of a second if somebody is silent.
            await clock.sleep(max(0.0, looked_at + INTERVAL_S - clock.now()))
            now = clock.now()
            found = await looking.look()
            changed, moving = rates(before.nodes, found.nodes, now - looked_at), movements(found.nodes)
            if live is None:
                emit_event(output, _document(found, changed, moving, now - looked_at), _lines(found, changed, moving))
            else:
                live.update(_screen(found, changed, moving), refresh=True)
            if once:
                return
            before, looked_at = found, now


def _terminal(output: Output, once: bool) -> AbstractContextManager[Live | None]:
    if output.json or once or not sys.stdout.isatty():
        return nullcontext()
    from rich.live import Live

    return Live(auto_refresh=False, screen=True)


def _summary(found: ClusterStatus, changed: list[Rate]) -> str:
    stored = [report for node in found.nodes if (report := node.report or node.last) is not None]
    records, size = sum(report.records for report in stored), sum(report.bytes for report in stored)
    rays = sum(node.report.rays_per_second for node in found.nodes if node.report is not None)
    gained = sum(rate.records_per_second or 0.0 for rate in changed)
    alive = sum(node.alive for node in found.nodes)
    return f"{found.name}: {alive} of {len(found.nodes)} nodes alive, {records:,} records ({gained:+,.0f}/s), {size_text(size)}, {rays:,} rays/s"


def _lines(found: ClusterStatus, changed: list[Rate], moving: list[Movement]) -> str:
    concerns = [f"warning: {warning.text}" for warning in found.warnings]
    return "\n".join(
        (_summary(found, changed), table(RATE_TITLES, rate_rows(changed)), *map(movement_text, moving), *strangers_text(found), *concerns)
    )


def _screen(found: ClusterStatus, changed: list[Rate], moving: list[Movement]) -> RenderableType:
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    rows = Table(box=None, pad_edge=False)
    for index, title in enumerate(RATE_TITLES):
        rows.add_column(title, justify="left" if index < 2 else "right")
    for row in rate_rows(changed):
        rows.add_row(*(Text(printable(cell)) for cell in row))
    lines = [Text(printable(movement_text(movement))) for movement in moving] or [Text("nothing is on its way", style="dim")]
    lines += [Text(text, style="dim") for text in strangers_text(found)]
    concerns = [Text(printable(f"warning: {warning.text}"), style="bold") for warning in found.warnings]
    return Group(Text(printable(_summary(found, changed))), Text(), rows, Text(), *lines, *concerns, Text("\nCtrl-C ends", style="dim"))


def _document(found: ClusterStatus, changed: list[Rate], moving: list[Movement], seconds: float) -> dict[str, Any]:
    return {
        "name": found.name,
        "seconds": seconds,
        "degraded": found.degraded,
        "nodes": [rate.document() for rate in changed],
        "handovers": [movement.document() for movement in moving],
        "warnings": [warning.document() for warning in found.warnings],
    }
