"""If this failed, two nodes with leases would acknowledge one place: the second of two lives would begin with the first one's arc.

Whole nodes: the second of four gives half of its arc away. A backup of its disk, made as it deletes what it has given, is put
back later. It begins anew as another incarnation, while it goes on to delete: that ends with a change of its holding, which
may queue behind the renewal.
"""

from __future__ import annotations

from functools import partial

import pytest
import trio

from scenefold.base.location import Arc, Location
from scenefold.peer.line import Side
from scenefold.peer.line.holding import Step
from scenefold.simulation.disks import arc_of, handovers_of, incarnation_of
from simulation.steps import Stage, play

NODE = 1
FOUNDERS = 4
LONG_S = 150.0
"""After so long, a lease was granted that the backup does not know of, and no answer that others hold is young."""
RENEWAL_S_MAX = 60.0


# Nodes say that one begins anew, as they should.
pytestmark = pytest.mark.usefixtures("silent")


async def restored_as_it_deletes(commit_s: float, stage: Stage) -> None:
    cluster, node = stage.cluster, stage.cluster.nodes[NODE]
    backups = []

    def look(slot: int) -> None:
        if slot == NODE and not backups and any(handover.step is Step.GIVEN for handover in handovers_of(node.disk)):
            backups.append(node.disk.snapshot())

    cluster.watch.on_handover = look
    arc = stage.owns(NODE)
    assert arc is not None and node.context is not None
    half = Arc(arc.first, Location.from_number(arc.first.number + arc.length // 2))
    await node.context.line.give(Side.LEFT, half, why="a test")
    await stage.until(stage.is_quiet)
    await trio.sleep(LONG_S)
    before, records = incarnation_of(node.disk), cluster.watch.records(NODE)
    cluster.crash(NODE)
    node.disk.restore(backups[0])
    cluster.watch.disk_replaced(NODE, records, before, "is put back to a backup")
    node.disk.slow(commit_s)
    await cluster.restart(NODE, 0.5)
    await stage.until(lambda: incarnation_of(node.disk) != before, RENEWAL_S_MAX)
    stage.check(arc_of(node.disk) is None, "the new incarnation has an arc at once")
    await trio.sleep(RENEWAL_S_MAX)
    stage.check(not cluster.watch.violations, str(cluster.watch.violations[:3]))
    node.disk.slow(0.0)


@pytest.mark.parametrize("commit_s", [0.01, 0.1, 1.0])
def test_a_giver_that_is_put_back_begins_anew_with_nothing(commit_s: float) -> None:
    play(partial(restored_as_it_deletes, commit_s), founders=FOUNDERS)
