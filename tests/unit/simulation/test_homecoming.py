"""If this fails, a node may drop strays that it has to bring home, and the judge takes that for a loss, or blames who dropped nothing."""

from __future__ import annotations

from scenefold.simulation import laws
from scenefold.simulation.disks import records_of
from scenefold.simulation.lies import STRAY
from scenefold.simulation.lineage import Holder
from scenefold.store.layout import RECORDS
from unit.simulation.test_watch import PLACE, RIGHT, Stage, member, record, rots, version


def adopted() -> Stage:
    """Machine 1 was removed, and 0 has its arc without the record that lies on 1."""
    stage = Stage()
    stage.machines[1].store(record(2))
    stage.watch.lineage.gone(Holder(1, member(1).incarnation))
    stage.change(0, stage.machines[0].holding.adopt(RIGHT, revision=1))
    return stage


def drops(stage: Stage) -> list[str]:
    """What is said if machine 1 deletes it."""
    assert stage.laws == []
    stage.machines[1].tables[RECORDS].clear()
    stage.watch.committed(1)
    stage.watch.homecoming.judge_rest()
    return stage.laws


def test_what_the_adopter_lacks_must_not_be_dropped() -> None:
    assert drops(adopted()) == [laws.BROUGHT_HOME]


def test_what_the_owner_has_by_then_may_go() -> None:
    for seq in (2, 3):
        stage = adopted()
        stage.machines[0].store(record(seq))
        assert drops(stage) == []


def test_that_the_owner_has_an_older_one_is_not_enough() -> None:
    stage = adopted()
    stage.machines[0].store(record(1))
    assert drops(stage) == [laws.BROUGHT_HOME]


def test_whose_owner_has_answered_and_lost_its_disk_then_may_drop_it() -> None:
    stage = adopted()
    stage.machines[0].store(record(2))
    stage.watch.homecoming.answered(0, PLACE, version(2))
    before = records_of(stage.machines[0])
    stage.machines[0].tables[RECORDS] = {}
    stage.watch.disk_replaced(0, before, member(0).incarnation, "is wiped")
    assert drops(stage) == []


def test_whose_owner_has_lost_its_disk_and_never_answered_must_keep_it() -> None:
    stage = adopted()
    stage.machines[0].store(record(3))
    before = records_of(stage.machines[0])
    stage.machines[0].tables[RECORDS] = {}
    stage.watch.disk_replaced(0, before, member(0).incarnation, "is wiped")
    assert drops(stage) == [laws.BROUGHT_HOME]


def test_what_a_newer_one_supersedes_on_its_disk_may_go_and_that_one_is_owed() -> None:
    for home, said in ((None, [laws.BROUGHT_HOME]), (2, [laws.BROUGHT_HOME]), (3, [])):
        stage = adopted()
        stage.machines[1].store(record(3))
        stage.watch.committed(1)
        assert stage.laws == []
        if home is not None:
            stage.machines[0].store(record(home))
        assert drops(stage) == said


def test_what_an_older_one_supersedes_is_dropped() -> None:
    stage = adopted()
    stage.machines[1].store(record(1))
    stage.watch.committed(1)
    assert stage.laws == [laws.BROUGHT_HOME]


def test_a_newer_one_is_not_owed_once_its_owner_has_answered() -> None:
    stage = adopted()
    stage.watch.homecoming.answered(0, PLACE, version(3))
    stage.machines[1].store(record(3))
    stage.watch.committed(1)
    assert drops(stage) == []


def test_a_wiped_disk_and_a_rotten_copy_owe_nothing() -> None:
    stage = adopted()
    before = records_of(stage.machines[1])
    stage.machines[1].tables[RECORDS] = {}
    stage.watch.disk_replaced(1, before, member(1).incarnation, "is wiped")
    assert drops(stage) == []
    stage = adopted()
    rots(stage, 1)
    assert drops(stage) == []


def test_a_lie_about_just_this_stray_is_reported() -> None:
    stage = adopted()
    lies = stage.watch.recorder.lies
    lies.loses(0, STRAY, PLACE, version(2).digest)
    assert drops(stage) == [] and lies.reported.total() == 1
    stage = adopted()
    stage.watch.recorder.lies.loses(0, STRAY, PLACE, version(1).digest)
    assert drops(stage) == [laws.BROUGHT_HOME]
