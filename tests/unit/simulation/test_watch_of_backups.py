"""If this fails, a restored backup that passes for the node itself is found only where a client stumbles over what is gone."""

from __future__ import annotations

from scenefold.simulation import laws
from unit.simulation.test_watch import HERE, PLACE, Stage, member, record, version


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
