"""If this fails, a simulation does not see that a node goes on with damaged tables, or blames a node that rightly stops."""

from __future__ import annotations

from contextlib import suppress
from random import Random

import pytest
import trio

from scenefold.base.errors import ScenefoldError
from scenefold.scene.layout import META
from scenefold.simulation import laws
from scenefold.simulation.calm import unrest
from scenefold.simulation.cluster import RESTART_S
from scenefold.simulation.disks import arc_of, holding_of, incarnation_of
from scenefold.store.layout import HOLDING, IDENTITY, NOTES
from simulation.quiet import Rest, at_rest

AGAIN_S = 60.0
"""A wiped node is removed, waited for, and joins again."""


async def until_calm(rest: Rest) -> None:
    with trio.fail_after(AGAIN_S):
        await trio.sleep(RESTART_S + 1)
        while unrest(rest.cluster):  # noqa: ASYNC110 - the disks are the truth, and tell nobody when they change
            await trio.sleep(0.5)


@pytest.mark.parametrize("table", [HOLDING, IDENTITY, NOTES])
def test_a_node_that_finds_its_tables_damaged_is_wiped_and_comes_back(table: str) -> None:
    async def look(rest: Rest) -> None:
        node = rest.cluster.nodes[1]
        before = incarnation_of(node.disk), arc_of(node.disk), holding_of(node.disk)
        assert node.disk.corrupt(table, Random(3)) is not None
        node.has_rotted = True
        assert (incarnation_of(node.disk), arc_of(node.disk), holding_of(node.disk)) == before, "until it stops, it acts by what it knows"
        assert rest.cluster.crash(1)
        await rest.cluster.restart(1, 0.2)
        await until_calm(rest)
        assert incarnation_of(node.disk) != before[0]
        assert rest.cluster.watch.counts["damage noticed"] == 1
        assert rest.cluster.watch.violations == []

    at_rest(look)


def test_a_running_node_stops_over_a_rotten_arc_before_it_acknowledges() -> None:
    async def look(rest: Rest) -> None:
        node = rest.cluster.nodes[1]
        assert node.disk.corrupt(HOLDING, Random(3), b"arc") == b"arc"
        node.has_rotted = True
        with trio.move_on_after(5), suppress(ScenefoldError):
            await rest.scene.space(META).put(rest.places[2], b"not to be acknowledged by this node")
        assert rest.cluster.watch.counts["damage noticed"] == 1
        await until_calm(rest)
        assert rest.cluster.watch.counts["damage noticed"] == 1
        assert rest.cluster.watch.violations == []

    at_rest(look)


def test_a_node_that_stops_although_nothing_has_rotted_is_blamed() -> None:
    async def look(rest: Rest) -> None:
        assert rest.cluster.nodes[1].disk.corrupt(IDENTITY, Random(3)) is not None
        assert rest.cluster.crash(1)
        await rest.cluster.restart(1, 0.2)
        await trio.sleep(RESTART_S)
        assert {violation.law for violation in rest.cluster.watch.violations} == {laws.SOUND}

    at_rest(look)
