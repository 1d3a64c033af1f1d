"""What is off about one node by its own report: lease, handovers, disk, stalls, and signs that somebody means harm. Pure."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from scenefold.client.reports import HandoverReport, NodeReport

HANDOVER_LONG_S = 60.0
"""A piece has 64 MiB, and goes in seconds; a newcomer's first one may be larger, and is worth a line all the same."""
NEARLY_FULL = 0.9
"""Balancing fills nobody further."""
RECENT_S = 600.0
"""What happened once is told of for so long."""


@dataclass(frozen=True, slots=True)
class Concern:
    """Something that is off. `degrades`: until it is mended some data cannot be had, or cannot be changed."""

    kind: str
    text: str
    degrades: bool
    address: str = ""

    def document(self) -> dict[str, Any]:
        return {"kind": self.kind, "address": self.address or None, "text": self.text, "degrades": self.degrades}


def own_warnings(address: str, report: NodeReport, newest: int) -> Iterable[Concern]:
    """Of the node at this address; `newest`: the last position of the cluster's log that any node knows."""
    if report.lease_s <= 0 and report.role != "joining":
        yield Concern("no lease", f"{address} has no lease: it takes no writes until the voter answers it", True, address)
    if report.role == "joining":
        yield Concern("joining", f"{address} owns nothing yet", False, address)
    if report.log_position < newest:
        behind = newest - report.log_position
        yield Concern("behind", f"{address} lacks the last {behind} entries of the cluster's log", False, address)
    for handover in report.handovers:
        yield from _of_handover(address, handover)
    if report.strays:
        text = f"{address} holds {strays_text(report)} records that belong elsewhere: they are being brought home"
        yield Concern("strays", text, False, address)
    if report.damaged:
        yield Concern("damaged", f"{address} has met {report.damaged} damaged records since its start: check its disk", True, address)
    if report.fill >= NEARLY_FULL:
        yield Concern("nearly full", f"{address} is {report.fill:.0%} full", True, address)
    if report.stall_ago_s is not None and report.stall_ago_s < RECENT_S:
        text = f"{address} did not run for {report.stall_last_s:.0f} s, {report.stall_ago_s:.0f} s ago: it slept, its clock jumped, or it was starved"
        yield Concern("stalled", text, False, address)
    # One line of each kind, however many the node names: it may be the one that lies.
    for sign in {sign.kind: sign for sign in report.signs}.values():
        if sign.kind in _SIGNS and sign.ago_s < RECENT_S:
            when = f"{sign.count} times, last {sign.ago_s:.0f} s ago by {sign.source}"
            yield Concern(sign.kind, _SIGNS[sign.kind].format(node=address, when=when), False, address)


def strays_text(report: NodeReport) -> str:
    """How many records lie elsewhere than they belong, as far as the node has counted."""
    return f"{report.strays:,} or more" if report.strays_more else f"{report.strays:,}"


_SIGNS = {
    "own key": "somebody else signs with the key of {node} (told {when}): revoke it, and let the node join again with new keys",
    "contested": "{node} is told that another node owns what it owns ({when}), by nothing that the cluster's log says: look at that node",
    "forged": "{node} is told statuses that other nodes did not sign ({when}): look at that node",
}


def _of_handover(address: str, handover: HandoverReport) -> Iterable[Concern]:
    if handover.step == "released" and handover.peer_removed:
        text = f"{address} is about to take back a piece that it had let go of: {handover.peer} was removed before it said that it has it"
        yield Concern("handover", text, True, address)
    elif handover.gives and handover.seconds >= HANDOVER_LONG_S:
        text = f"{address} has been giving a piece to {handover.peer} for {handover.seconds:.0f} s: it is {handover.step}"
        yield Concern("handover", text, handover.step == "released", address)
