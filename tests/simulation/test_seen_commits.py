"""If this fails, a commit over which a machine dies at that instant is not seen by all judges, and they take what follows for a fault."""

from __future__ import annotations

from contextlib import suppress

import pytest
import trio

from scenefold.base.errors import Refused
from scenefold.base.location import Arc, Location
from scenefold.peer.line import Side
from scenefold.store.layout import HOLDING
from scenefold.world import DiskFailed
from simulation.steps import Stage, play

GIVER, RECEIVER = 1, 0

pytestmark = pytest.mark.usefixtures("silent")


async def give_and_die(stage: Stage) -> None:
    """The watch sees a step of a handover, and kills the giver at that instant."""
    giver, seen, deaths = stage.cluster.nodes[GIVER], list[bool](), list[int]()

    def look(slot: int) -> None:
        if slot == GIVER:
            seen.append(bool(giver.disk.replaced(HOLDING)))

    def kill(slot: int) -> None:
        if slot == GIVER and not deaths:
            deaths.append(len(seen))
            stage.cluster.crash(GIVER)

    stage.cluster.lookers.append(look)
    stage.cluster.watch.on_handover = kill
    arc, context = stage.owns(GIVER), giver.context
    assert arc is not None and context is not None
    piece = Arc(arc.first, Location.from_number(arc.first.number + arc.length // 2))

    async def give() -> None:
        # That it fails is no fault: its node dies.
        with suppress(Refused, DiskFailed):
            await context.line.give(Side.LEFT, piece, why="a test")

    async with trio.open_nursery() as nursery:
        nursery.start_soon(give)
        await stage.until(lambda: bool(deaths), 10.0)
        nursery.cancel_scope.cancel()
    assert seen[deaths[0] - 1], "the commit was looked at once its machine was dead"
    await stage.cluster.restart(GIVER, 1.0)


def test_all_see_a_commit_before_its_machine_dies_over_it() -> None:
    play(give_and_die, founders=2)
