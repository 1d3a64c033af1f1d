"""If this fails, a record may be told that lies on too few disks, or lose copies that are needed, and the judge says nothing; or it blames who is right."""

from __future__ import annotations

from dataclasses import replace

import pytest

from scenefold.base.prefixes import Blacklist, address_prefix
from scenefold.peer.copies.copies import Copies
from scenefold.peer.copies.copies_note import encode_copies
from scenefold.peer.copies.custody import Custody
from scenefold.peer.copies.entries import Entry
from scenefold.peer.membership.blacklist import NOTE, encode_blacklist
from scenefold.simulation import laws
from scenefold.simulation.copying import Rule
from scenefold.simulation.disks import records_of
from scenefold.simulation.history import Loss
from scenefold.simulation.keeping import RECENT_S
from scenefold.simulation.lineage import Holder
from scenefold.simulation.passed import LATELY_S
from scenefold.store.layout import HOLDING, IDENTITY, NOTES, RECORDS
from scenefold.store.sealing import sealed
from unit.simulation.test_watch import HERE, LEFT, MIDDLE, PLACE, RIGHT, SCENE, SPACE, Stage, member, record, rots, version

OWNER = 1


def stage_with(*slots: int, needed: int = 2, racks: int = 0, seq: int = 1) -> Stage:
    """The record lies on these disks; machine 1 owns its place."""
    stage = Stage()
    stage.watch.keeping.rules[SCENE, SPACE] = Rule((HERE, HERE), needed)
    stage.watch.keeping.racks = racks
    stage.watch.keeping.registered(frozenset(Holder(slot, member(slot).incarnation) for slot in stage.machines))
    for slot in slots:
        stage.machines[slot].store(record(seq))
    return stage


def told(stage: Stage) -> Stage:
    stage.watch.acknowledges(OWNER, PLACE, version(1), HERE)
    assert stage.laws == []
    return stage


def drops(stage: Stage, slot: int) -> None:
    """A commit in which the copy leaves a disk."""
    machine = stage.machines[slot]
    machine.last_commit = list(machine.tables[RECORDS].items())
    machine.tables[RECORDS] = {}
    stage.watch.committed(slot)


def loses(stage: Stage, slot: int) -> None:
    """The disk is gone; an empty one, of another incarnation, takes its place."""
    before = records_of(stage.machines[slot])
    stage.machines[slot].tables[RECORDS] = {}
    stage.watch.disk_replaced(slot, before, member(slot).incarnation, "is lost")


def holds(stage: Stage, slot: int) -> None:
    """It has custody of the place."""
    machine, me = stage.machines[slot], member(slot)
    entry = Entry((LEFT.last, MIDDLE), RIGHT, 1, (member(OWNER), me), 2, whole=True)
    note = encode_copies(replace(Copies.of(me), custody=Custody((entry,))))
    machine.tables[HOLDING][b"copies"] = sealed(HOLDING, b"copies", note)
    machine.tables[IDENTITY][b"node"] = sealed(IDENTITY, b"node", me.node.to_bytes(4, "big"))


def losses(stage: Stage) -> list[Loss]:
    return [event for event in stage.watch.recorder.histories.of(PLACE) if isinstance(event, Loss)]


@pytest.mark.parametrize(("slots", "right"), [((1,), False), ((1, 2), True), ((0, 1, 2), True)])
def test_what_is_told_is_on_as_many_disks_as_it_must(slots: tuple[int, ...], right: bool) -> None:
    by_node, by_reader = stage_with(*slots), stage_with(*slots)
    by_node.watch.acknowledges(OWNER, PLACE, version(1), HERE)
    by_reader.watch.recorder.told("c", PLACE, version(1))
    assert by_node.laws == by_reader.laws == ([] if right else [laws.COPIED])


def test_a_disk_that_the_owner_forbids_does_not_count() -> None:
    stage = stage_with(0, 1, racks=1)
    stage.watch.acknowledges(OWNER, PLACE, version(1), HERE)
    assert stage.laws == [laws.COPIED]
    assert stage_with(0, 1, racks=2) and told(stage_with(0, 1, racks=2))


@pytest.mark.parametrize(("listed", "broken"), [("0.0.0.0/0", []), ("10.0.0.1", [laws.COPIED]), ("10.0.0.0/30", [])])
def test_what_an_owner_forbids_by_now_need_not_have_what_is_read(listed: str, broken: list[str]) -> None:
    stage = stage_with(OWNER)
    key = NOTE.encode()
    note = encode_blacklist(Blacklist(1, (address_prefix(listed),)))
    stage.machines[OWNER].tables[NOTES][key] = sealed(NOTES, key, note)
    stage.watch.committed(OWNER)
    stage.watch.recorder.told("c", PLACE, version(1))
    assert stage.laws == broken


def test_fewer_nodes_than_must_hold_it_are_enough() -> None:
    stage = stage_with(1)
    stage.watch.keeping.registered(frozenset({Holder(1, member(1).incarnation)}))
    told(stage)


def test_a_disk_that_was_lost_a_moment_ago_counts_and_later_does_not() -> None:
    for after_s, right in ((RECENT_S / 2, True), (RECENT_S * 2, False)):
        stage = stage_with(1, 2)
        loses(stage, 2)
        stage.now = after_s
        stage.watch.acknowledges(OWNER, PLACE, version(1), HERE)
        assert stage.laws == ([] if right else [laws.COPIED])


def test_what_was_told_may_be_read_after_disks_were_lost_and_what_was_not_may_not_from_too_few() -> None:
    stage = told(stage_with(1, 2))
    loses(stage, 2)
    stage.now = 2 * RECENT_S
    stage.watch.recorder.told("c", PLACE, version(1))
    assert stage.laws == []
    stage.machines[OWNER].store(record(2))
    stage.watch.recorder.told("c", PLACE, version(2))
    assert stage.laws == [laws.COPIED]


def test_a_copy_may_leave_if_enough_are_left_and_the_owner_has_one() -> None:
    stage = told(stage_with(0, 1, 2))
    drops(stage, 2)
    assert stage.laws == []
    drops(stage, 0)
    assert stage.laws == [laws.KEPT]


def test_a_copy_may_not_leave_if_the_owner_has_none() -> None:
    stage = told(stage_with(0, 1, 2))
    drops(stage, OWNER)
    assert stage.laws == [laws.KEPT]


def test_what_was_never_told_may_leave() -> None:
    stage = stage_with(0, 1, 2)
    drops(stage, 0)
    drops(stage, 1)
    assert stage.laws == []


def test_what_lies_on_a_disk_that_is_left_is_not_lost() -> None:
    stage = told(stage_with(0, 1, 2))
    loses(stage, 0)
    loses(stage, 1)
    assert losses(stage) == []
    loses(stage, 2)
    assert [(loss.newest, loss.or_nothing) for loss in losses(stage)] == [(version(1), True)]


def test_what_was_on_too_few_disks_to_be_told_is_excused_by_nothing() -> None:
    stage = stage_with(0, 2)
    stage.machines[OWNER].store(record(2))
    loses(stage, OWNER)
    assert losses(stage) == []


def test_an_older_version_on_a_disk_that_is_left_must_be_there() -> None:
    stage = stage_with(1, 2, seq=2)
    stage.machines[0].store(record(1))
    loses(stage, 1)
    loses(stage, 2)
    assert [(loss.newest, loss.left, loss.or_nothing) for loss in losses(stage)] == [(version(2), (version(1),), False)]


def test_who_had_a_newer_version_that_was_lost_is_a_witness_of_the_older_one_too() -> None:
    stage = stage_with(1, 2, seq=2)
    stage.machines[0].store(record(1))
    for slot in (1, 2, 0):
        loses(stage, slot)
    assert [(loss.newest, loss.or_nothing) for loss in losses(stage)] == [(version(2), False), (version(1), True)]


def test_who_is_removed_is_not_asked_and_may_bring_it_back() -> None:
    stage = told(stage_with(1, 2))
    loses(stage, OWNER)
    assert losses(stage) == []
    stage.watch.removed(2, member(2).incarnation)
    assert [(loss.newest, loss.left, loss.or_nothing) for loss in losses(stage)] == [(version(1), (version(1),), True)]


def test_one_machine_that_loses_two_disks_is_one_witness() -> None:
    stage = told(stage_with(1, 2))
    loses(stage, 2)
    stage.machines[2].store(record(1))
    stage.watch.keeping.gone(2, b"another", records_of(stage.machines[2]))
    stage.machines[2].tables[RECORDS] = {}
    drops(stage, OWNER)
    assert losses(stage) == []


def test_what_is_written_after_a_loss_needs_witnesses_of_its_own() -> None:
    stage = told(stage_with(1, 2, seq=1))
    for slot in (1, 2):
        loses(stage, slot)
    assert len(losses(stage)) == 1
    stage.machines[0].store(record(1))
    stage.watch.keeping.gone(0, member(0).incarnation, records_of(stage.machines[0]))
    assert len(losses(stage)) == 1


def test_what_stands_in_the_owners_rack_does_not_count_when_a_copy_leaves() -> None:
    stage = told(stage_with(0, 1, 2, racks=2))
    stage.machines[2].tables[RECORDS] = {}
    stage.watch.keeping.racks = 2
    drops(stage, 0)
    assert stage.laws == [laws.KEPT], "1 owns it, and neither 0 nor 2 stands in its rack, but 2 has it no more"


@pytest.mark.parametrize(("slots", "broken"), [((0, 1, 2), []), ((0, 1), [laws.KEPT])])
def test_where_an_owner_allows_too_few_all_that_have_it_count_when_a_copy_leaves(slots: tuple[int, ...], broken: list[str]) -> None:
    """All stand in one rack: nobody may take the place of those that the owner forbids, so as many as are needed stay."""
    stage = told(stage_with(*slots))
    stage.watch.keeping.racks = 1
    drops(stage, 0)
    assert stage.laws == broken


@pytest.mark.parametrize("passed_s", [0.0, 2 * LATELY_S])
def test_by_the_word_of_who_passed_the_place_on_a_copy_leaves_at_once_and_not_later(passed_s: float) -> None:
    stage = told(stage_with(0, 1, 2, racks=2))
    stage.give(1, 2)
    stage.now += passed_s
    drops(stage, 1)
    assert stage.laws == ([laws.KEPT] if passed_s else []), "0 and 2 stand in one rack"


def test_by_nobodys_word_a_copy_leaves_too_few() -> None:
    stage = told(stage_with(0, 1, racks=2))
    stage.give(1, 2, copied=False)
    drops(stage, 1)
    assert laws.KEPT in stage.laws, "by the rules of no owner two are left"


def test_a_rack_that_is_lost_loses_nothing() -> None:
    stage = stage_with(0, 1, 2, racks=2)
    told(stage)
    stage.machines[1].tables[RECORDS] = {}
    for slot in (0, 2):
        loses(stage, slot)
    assert losses(stage) == [], "both stood in one rack, so a third one must have had it"
    stage = told(stage_with(0, 1, racks=2))
    for slot in (0, 1):
        loses(stage, slot)
    assert len(losses(stage)) == 1


def test_a_cluster_that_was_small_once_is_not_small_for_ever() -> None:
    stage = stage_with(1)
    everybody = stage.watch.keeping.members
    stage.watch.keeping.registered(frozenset(list(everybody)[:1]))
    stage.now = 1.0
    stage.watch.keeping.registered(everybody)
    told(stage)
    stage.now = 2 * RECENT_S + 1.0
    stage.watch.acknowledges(OWNER, PLACE, version(1), HERE)
    assert stage.laws == [laws.COPIED]


def test_who_lies_about_its_copy_is_counted_on_and_may_have_lost_it() -> None:
    stage = stage_with(1)
    stage.watch.lied_about_copy(2, PLACE)
    assert losses(stage) == []
    told(stage)
    loses(stage, OWNER)
    assert [loss.newest for loss in losses(stage)] == [version(1)]
    assert stage.watch.recorder.lies.reported.total() == 1


def test_what_a_third_one_has_no_liar_can_lose() -> None:
    stage = told(stage_with(0, 1))
    stage.watch.lied_about_copy(2, PLACE)
    loses(stage, OWNER)
    assert losses(stage) == []


@pytest.mark.parametrize(("rotten", "by_rot"), [((2,), True), ((), False)])
def test_what_is_lost_since_other_copies_have_rotted_is_told_apart(rotten: tuple[int, ...], by_rot: bool) -> None:
    stage = told(stage_with(1, 2))
    for slot in rotten:
        rots(stage, slot)
    for slot in {1, 2} - {*rotten}:
        loses(stage, slot)
    assert len(losses(stage)) == 1
    assert (PLACE in stage.watch.keeping.by_rot) is by_rot


def test_what_enough_lost_disks_explain_is_no_loss_by_rot() -> None:
    stage = told(stage_with(0, 1, 2))
    holds(stage, 2)
    rots(stage, 0)
    loses(stage, 1)
    loses(stage, 2)
    assert losses(stage) and PLACE not in stage.watch.keeping.by_rot


@pytest.mark.parametrize("is_stray", [True, False])
def test_where_all_who_hold_it_have_it_rotten_a_stray_is_no_proof_that_nothing_is_lost(is_stray: bool) -> None:
    stage = told(stage_with(0, 1, 2))
    holds(stage, 2)
    if not is_stray:
        holds(stage, 0)
    rots(stage, 1)
    rots(stage, 2)
    assert [(loss.left, loss.or_nothing) for loss in losses(stage)] == ([((version(1),), True)] if is_stray else [])


def test_one_that_all_are_asked_for_is() -> None:
    stage = told(stage_with(0, 1, 2))
    loses(stage, 1)
    loses(stage, 2)
    assert losses(stage) == []
