"""`scenectl node drain`: the order, and how far the node is, until it has left."""

from __future__ import annotations

from typing import TYPE_CHECKING

from scenectl.output import size_text
from scenefold.base.errors import LocalFault, PeerFault, Refused, Unreachable
from scenefold.base.reasons import RejectReason

if TYPE_CHECKING:
    from scenefold.client import Cluster, DrainReport, ProgressCallback

LOOK_S = 1.0
SILENCE_S_MAX = 30.0
"""A node that has left ends by itself; one that died while it drained goes on when it is started again."""


async def leave(cluster: Cluster, address: str, progress: ProgressCallback) -> DrainReport:
    """Have the node give everything away and leave; Cancelled, the node goes on all the same."""
    from dataclasses import replace

    from scenefold.base.ids import node_id_of
    from scenefold.client import ProgressState

    clock = cluster.calls.world.clock
    report = await cluster.drain(address)
    total, heard_at = report.records, clock.now()
    while report.state != "left":
        if report.state == "serving":
            raise Refused(RejectReason.NOT_AUTHORISED, "somebody cancelled the draining", where=address, remedy="begin it again")
        waiting = f" (waiting: {report.text})" if report.text else ""
        total = max(total, report.records)
        progress(ProgressState("drain", total - report.records, total, f"records{waiting}", report.seconds_left))
        await clock.sleep(LOOK_S)
        try:
            report, heard_at = await cluster.drain(address, check_only=True), clock.now()
        except (Unreachable, Refused, PeerFault) as silence:
            if node_id_of(address) not in [owner.node_id for owner in await cluster.nodes()]:
                break
            if clock.now() - heard_at > SILENCE_S_MAX:
                remedy = "start it again: it goes on draining"
                raise Unreachable("the node fell silent before it had left", where=address, remedy=remedy) from silence
    progress(ProgressState("drain", total, total, "records"))
    return replace(report, state="left", records=0, bytes=0, seconds_left=0.0, may_switch_off=True, obstacles=(), text="")


def could_leave(report: DrainReport) -> bool:
    """Whether nothing is known that would keep a node from leaving, were it told to now."""
    return not report.cannot_leave and (report.room_bytes is None or report.room_bytes >= report.bytes)


def plan_text(address: str, report: DrainReport) -> str:
    """What an order to leave would do, or what keeps the node from it."""
    if report.state == "left":
        return f"Node {address} has left already."
    if report.cannot_leave:
        return f"Node {address} would refuse: {report.cannot_leave}."
    state = "is on its way out already, and still has" if report.state == "draining" else "would hand over what it owns of"
    text = f"Node {address} {state} {report.records:,} records, {size_text(report.bytes)}, copies among them. Nothing is changed."
    if report.state == "serving" and report.text:
        text += f"\nIt would give nothing to a neighbour: {report.text}."
    if report.room_bytes is None:
        return text
    if report.room_bytes >= report.bytes:
        return f"{text}\nIts neighbours have room for {size_text(report.room_bytes)}."
    return f"{text}\nIts neighbours have room for {size_text(report.room_bytes)}: it might have to wait for more."


async def check_known(cluster: Cluster, address: str) -> None:
    """LocalFault if no node of that address is on the line."""
    known = [owner.address for owner in await cluster.nodes()]
    if address not in known:
        raise LocalFault("no node of this address is a member", where=address, remedy=f"choose of {', '.join(known[:8])}")
