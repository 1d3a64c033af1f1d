"""How to wait until every record of a cluster of processes has its copies where they belong."""

from __future__ import annotations

import trio

from integration.living_clusters import Living
from scenefold.base.errors import ScenefoldError
from scenefold.client.reports import NodeReport

LOOK_S = 0.5


async def whole(
    living: Living, nodes: int, patience_s: float, *, while_writing: bool = False, at_rest: bool = False
) -> dict[str, NodeReport]:
    """Reports of the first moment at which every record lies where it should, and nothing is on its way but what is being written.

    `at_rest`: nor has balance anything to do, which would move on later what was moved for another reason.
    """
    is_so = is_placed if while_writing else is_at_rest if at_rest else is_whole
    found: dict[str, NodeReport | ScenefoldError] = {}
    with trio.move_on_after(patience_s):
        while True:
            found = dict(await living.cluster.reports(living.nodes.addresses))
            told = {address: report for address, report in found.items() if isinstance(report, NodeReport)}
            if len(told) == nodes and sum(report.arc is not None for report in told.values()) == nodes and all(map(is_so, told.values())):
                return told
            await trio.sleep(LOOK_S)
    raise AssertionError(
        f"not whole after {patience_s:g} s: {[one.copies if isinstance(one, NodeReport) else one for one in found.values()]}"
    )


def is_placed(report: NodeReport) -> bool:
    copies = report.copies
    if copies is None:
        return False
    waits = (copies.under_copied, copies.mis_placed, copies.forbidden, copies.comparing)
    return not (any(part.records or part.segments for part in waits) or copies.unrecovered)


def is_whole(report: NodeReport) -> bool:
    return is_placed(report) and report.copies is not None and not (report.copies.owed or report.copies.unsettled)


def is_at_rest(report: NodeReport) -> bool:
    return is_whole(report) and not (report.document["handovers"] or report.document["balance"]["to_give"])
