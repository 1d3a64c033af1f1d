"""If this fails, a restored backup that passes for the node itself is found only where a client stumbles over what is gone."""

from __future__ import annotations

import pytest

from scenefold.peer.line.ends import Side
from scenefold.peer.line.holding import handover_id
from scenefold.simulation import laws
from unit.simulation.test_watch import HERE, PLACE, RIGHT, Stage, member, record, version


def test_a_backup_acknowledges_nothing_under_its_old_incarnation() -> None:
    stage = Stage()
    stage.machines[1].store(record(1))
    stage.watch.disk_replaced(1, {}, member(1).incarnation, "is put back to a backup")
    stage.watch.acknowledges(1, PLACE, version(1), HERE)
    assert stage.laws == [laws.RIGHT_TO_ANSWER]


def test_as_a_newcomer_it_may() -> None:
    stage = Stage()
    stage.machines[1].store(record(1))
    stage.watch.disk_replaced(1, {}, b"of before".ljust(16), "is put back to a backup")
    stage.watch.acknowledges(1, PLACE, version(1), HERE)
    assert stage.laws == []


@pytest.mark.parametrize("replaced", [True, False])
def test_letting_go_is_not_wrong_if_the_receivers_disk_is_gone_since_it_had_kept_all(replaced: bool) -> None:
    """It was replaced while the release was on its way to the giver's disk."""
    stage = Stage()
    stage.machines[1].store(record(1))
    holding = stage.machines[1].holding
    handover = handover_id(holding.revision + 1, bytes(8))
    offered = holding.offer(handover, Side.RIGHT, member(2), RIGHT)
    stage.change(1, offered)
    if replaced:
        stage.watch.disk_replaced(2, {PLACE: version(1)}, member(2).incarnation, "is put back to a backup")
    stage.change(1, offered.release(handover))
    assert stage.laws == ([] if replaced else [laws.CARRIED])
