"""A cluster for people: the tables of `cluster status`, `nodes` and `top`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from scenectl.output import counted, size_text, table

if TYPE_CHECKING:
    from scenefold.base.location import Arc
    from scenefold.client import ClusterStatus, Movement, NodeState, Rate, RemovedNode

UNKNOWN = "?"
ARC_DIGITS = 8
INCARNATION_DIGITS = 8
REMOVALS_SHOWN = 5


def status_text(found: ClusterStatus) -> str:
    """Who is there, what they own and hold, and what is off."""
    rows = [
        (
            node.address,
            "alive" if node.alive else "missing",
            role_text(node),
            arc_text(node.arc),
            f"{node.share:.1%}",
            UNKNOWN if node.report is None else size_text(node.report.used_bytes),
            UNKNOWN if node.report is None else f"{node.report.fill:.1%}",
            seconds_text(node.heard_s),
        )
        for node in found.nodes
    ]
    missing = sum(not node.alive for node in found.nodes)
    summary = f"{found.name}: {len(found.nodes) - missing} of {len(found.nodes)} nodes alive, as {found.asked} knows it"
    titles = ("node", "state", "role", "arc", "line", "disk used", "of disk", "last heard")
    notes = [*_blacklists(found), *_removals(found), *strangers_text(found), *(f"warning: {warning.text}" for warning in found.warnings)]
    return "\n".join((summary, "", table(titles, rows), *(["", *notes] if notes else [])))


def nodes_text(found: ClusterStatus) -> str:
    """The members in line order, with what is known of each."""
    titles = ("node", "id", "role", "arc", "line", "used", "capacity", "records", "last heard", "incarnation", "boot")
    notes = _blacklists(found)
    return "\n".join((table(titles, map(_node_row, found.nodes)), *(["", *notes] if notes else [])))


def _node_row(node: NodeState) -> Sequence[object]:
    document, report = node.document(), node.report
    return (
        node.address,
        document["id"],
        role_text(node),
        arc_text(node.arc),
        f"{node.share:.1%}",
        UNKNOWN if report is None else size_text(report.used_bytes),
        UNKNOWN if report is None else size_text(report.capacity_bytes),
        UNKNOWN if report is None else report.records,
        seconds_text(node.heard_s),
        document["incarnation"][:INCARNATION_DIGITS],
        UNKNOWN if report is None else report.boot,
    )


def role_text(node: NodeState) -> str:
    """What the node is, and whether it is trusted with the authority's key."""
    return f"{node.role}, trusted" if node.report is not None and node.report.trusted else node.role


def _blacklists(found: ClusterStatus) -> Sequence[str]:
    """A line for each node that keeps its copies away from others; none if nobody does."""
    return [f"{node.address} wants no copies of its data on {', '.join(node.blacklist)}" for node in found.nodes if node.blacklist]


def _removals(found: ClusterStatus) -> Sequence[str]:
    """A line for each of those that left last: else a node that was removed is only missing from the table."""
    shown = [f"{one.address} is no member any more: {one.reason} (position {one.position})" for one in found.removed[:REMOVALS_SHOWN]]
    left_out = len(found.removed) - len(shown)
    return [*shown, f"and {left_out} more: scenectl cluster nodes --removed"] if left_out else shown


def strangers_text(found: ClusterStatus) -> Sequence[str]:
    """A line if anything was refused at any node's ports; none otherwise."""
    reports = [report for node in found.nodes if (report := node.report or node.last) is not None]
    away, dropped = sum(report.turned_away for report in reports), sum(report.dropped for report in reports)
    return (
        [f"turned away since the nodes started: {counted(away, 'connection')}, {counted(dropped, 'datagram')}"] if away or dropped else []
    )


def removed_text(found: Sequence[RemovedNode]) -> str:
    """All removals, newest first."""
    titles = ("node", "position", "proposed by", "incarnation", "now", "reason")
    rows = [
        (one.address, one.position, one.by, one.incarnation.hex()[:INCARNATION_DIGITS], "back" if one.is_back else "gone", one.reason)
        for one in found
    ]
    return table(titles, rows) if rows else "No node was ever removed."


RATE_TITLES = ("node", "role", "line", "full", "records", "records/s", "bytes/s", "rays/s")


def rate_rows(found: Sequence[Rate]) -> Sequence[Sequence[str]]:
    """A row of `cluster top` for each node."""
    rows = []
    for rate in found:
        node = rate.node
        report = node.report or node.last
        rows.append(
            (
                node.address,
                node.role if node.alive else "missing" if report is None else f"silent {seconds_text(node.last_s)}",
                f"{node.share:.1%}",
                UNKNOWN if report is None else f"{report.fill:.1%}",
                UNKNOWN if report is None else f"{report.records:,}",
                UNKNOWN if rate.records_per_second is None else f"{rate.records_per_second:+,.0f}",
                UNKNOWN if rate.bytes_per_second is None else f"{_signed_size(rate.bytes_per_second)}",
                UNKNOWN if node.report is None else f"{node.report.rays_per_second:,}",
            )
        )
    return rows


def movement_text(movement: Movement) -> str:
    """A handover on one line."""
    arrived = UNKNOWN if movement.records_arrived is None else f"{movement.records_arrived:,}"
    total = UNKNOWN if movement.records is None else f"{movement.records:,}"
    how_far = f"{movement.progress:.0%}, {arrived} of {total} records" if movement.step in ("offered", "noted") else movement.step
    return f"{movement.giver} -> {movement.receiver}  {arc_text(movement.piece)}  {how_far}, for {movement.seconds:.0f} s"


def arc_text(arc: Arc | None) -> str:
    """The leading digits of both ends."""
    return "nothing" if arc is None else f"{arc.first.hex()[:ARC_DIGITS]}..{arc.last.hex()[:ARC_DIGITS]}"


def seconds_text(seconds: float | None) -> str:
    """How long ago, for people."""
    if seconds is None:
        return "never"
    return f"{seconds:.1f} s" if seconds < 60 else f"{seconds / 60:.0f} min"


def _signed_size(count: float) -> str:
    return f"{'+' if count >= 0 else '-'}{size_text(abs(count))}"
