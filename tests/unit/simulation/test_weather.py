"""If this fails, schedules are not what a seed says, or a kind of fault hardly ever comes."""

from __future__ import annotations

from collections import Counter

import pytest

from scenefold.simulation.copying import Copying, rack
from scenefold.simulation.faults import CLIENTS, KINDS, VOTER, Fault, Kind, Whom
from scenefold.simulation.outcome import WORKLOADS, Order
from scenefold.simulation.weather import FAULTS_MIN, LONG_S, MEMBERSHIP, Climate, draw, spares_of
from scenefold.simulation.workload import PAUSE_S

FIVE = Climate(5)
KEEPING = Climate(5, copying=Copying(3, 2, 3))
ALONE = [kind for kind in Kind if not (KINDS[kind].of_copies or KINDS[kind].of_clients or KINDS[kind].of_renders)]
"""Kinds of storms in which every record lies on one disk, nothing befalls clients, and nobody renders."""


def test_a_thousand_seeds_have_five_hundred_of_each_kind_with_room_to_spare() -> None:
    counts = Counter(fault.kind for seed in range(1000) for fault in draw(seed, FIVE))
    assert {kind: counts[kind] for kind in ALONE if counts[kind] < 600 and not KINDS[kind].is_later} == {}


def test_what_came_later_is_in_two_seeds_of_five_and_these_are_what_they_were_else() -> None:
    later = {kind for kind in Kind if KINDS[kind].is_later}
    assert later == {Kind.POWER, Kind.SLEEP}
    with_it = [draw(seed, FIVE) for seed in range(1000)]
    for kind in later:
        assert 330 < sum(fault.kind is kind for schedule in with_it for fault in schedule) < 470
        assert {fault.slots for schedule in with_it for fault in schedule if fault.kind is kind} == {()}
    with pytest.MonkeyPatch.context() as patch:
        for kind in later:
            patch.delitem(KINDS, kind)
        without = [draw(seed, FIVE) for seed in range(1000)]
    assert without == [tuple(fault for fault in schedule if fault.kind not in later) for schedule in with_it]


def test_each_kind_is_missing_in_a_quarter_of_all_seeds() -> None:
    there = Counter(kind for seed in range(1000) for kind in {fault.kind for fault in draw(seed, FIVE)})
    assert {kind: there[kind] for kind in ALONE if there[kind] > 750} == {}


def test_a_seed_is_a_schedule() -> None:
    assert draw(7, FIVE) == draw(7, FIVE)
    assert draw(7, FIVE) != draw(8, FIVE)


def test_every_seed_has_faults_and_they_are_in_order() -> None:
    for seed in range(200):
        schedule = draw(seed, FIVE)
        assert len(schedule) >= FAULTS_MIN
        assert [fault.begin_s for fault in schedule] == sorted(fault.begin_s for fault in schedule)
        assert all(fault.begin_s <= fault.end_s for fault in schedule)


def test_the_voters_disk_is_never_taken_away() -> None:
    for seed in range(300):
        for fault in draw(seed, FIVE):
            if KINDS[fault.kind].whom is Whom.NO_VOTER:
                assert 0 not in fault.slots


def test_slots_are_founders_or_spares_of_ones_own() -> None:
    for seed in range(200):
        schedule = draw(seed, FIVE)
        spares = [slot for fault in schedule for slot in fault.slots if slot >= 5]
        assert len(spares) == len(set(spares))
        assert spares_of(schedule, 5) == sorted(spares)


def test_without_members_nobody_joins_or_leaves() -> None:
    for seed in range(100):
        assert not any(KINDS[fault.kind].moves_members for fault in draw(seed, Climate(5, members=False)))


def test_workloads_differ_in_what_moves_members() -> None:
    shares = {}
    for workload in WORKLOADS:
        schedules = [Order(seed, workload=workload).schedule for seed in range(100)]
        faults = [fault.kind for schedule in schedules for fault in schedule]
        shares[workload] = sum(kind in MEMBERSHIP for kind in faults) / len(faults)
        kinds = [{fault.kind for fault in schedule} for schedule in schedules]
        assert all({Kind.JOIN, Kind.DRAIN} <= each for each in kinds) is (workload == "members")
        assert any(KINDS[kind].moves_members for kind in faults) is (workload != "data")
    assert shares["data"] < shares["all"] < 0.4 and shares["members"] > 2 / 3
    assert shares["keys"] == shares["all"]
    assert PAUSE_S["members"] > 2 * PAUSE_S["all"]


@pytest.mark.parametrize("kinds", [(Kind.JOIN,), (Kind.ONE_WAY,), (Kind.RESTORED_BACKUP, Kind.JOIN), (Kind.CRASH, Kind.LOSS, Kind.DRAIN)])
def test_a_climate_of_some_kinds_has_each_of_them_and_no_other(kinds: tuple[Kind, ...]) -> None:
    for seed in range(50):
        schedule = draw(seed, Climate(5, kinds=kinds))
        assert {fault.kind for fault in schedule} == set(kinds)
        assert len(schedule) >= FAULTS_MIN or kinds == (Kind.JOIN,)


def test_the_voter_is_often_and_for_long_deaf_to_a_node_that_all_others_hear() -> None:
    def is_such(fault: Fault) -> bool:
        return fault.kind is Kind.ONE_WAY and fault.slots[1] == VOTER and fault.end_s - fault.begin_s >= LONG_S

    assert sum(any(map(is_such, draw(seed, FIVE))) for seed in range(200)) > 40


@pytest.mark.parametrize("nodes", [3, 4, 7, 50])
def test_any_size_can_be_drawn(nodes: int) -> None:
    for seed in range(50):
        for fault in draw(seed, Climate(nodes)):
            assert len(set(fault.slots)) == len(fault.slots)
            if KINDS[fault.kind].whom is Whom.GROUP:
                assert 0 < len(fault.slots) * 2 < nodes + 1


def test_a_fault_reads_like_a_sentence() -> None:
    lines = {fault.kind: str(fault) for seed in range(30) for fault in draw(seed, FIVE)}
    assert set(lines) == set(ALONE)
    assert all(kind.value in line for kind, line in lines.items())


def test_with_copies_a_seed_has_all_that_it_has_without_and_often_more() -> None:
    counts = Counter[Kind]()
    for seed in range(300):
        more = set(draw(seed, KEEPING)) - set(draw(seed, FIVE))
        assert len(draw(seed, KEEPING)) == len(draw(seed, FIVE)) + len(more)
        assert all(KINDS[fault.kind].of_copies for fault in more)
        counts.update({fault.kind for fault in more})
    assert set(counts) == {kind for kind in Kind if KINDS[kind].of_copies}
    assert min(counts.values()) > 100 and max(counts.values()) < 225


def test_what_befalls_clients_comes_on_top_and_starts_no_spare() -> None:
    counts, asked = Counter[Kind](), Climate(3, of_clients=True)
    for seed in range(300):
        more = set(draw(seed, asked)) - set(draw(seed, Climate(3)))
        assert len(draw(seed, asked)) == len(draw(seed, Climate(3))) + len(more)
        assert all(KINDS[fault.kind].whom is Whom.CLIENT and 0 <= fault.slots[0] < CLIENTS for fault in more)
        assert spares_of(draw(seed, asked), 3) == spares_of(draw(seed, Climate(3)), 3)
        counts.update({fault.kind for fault in more})
        assert all(f"c{fault.slots[0]}" in str(fault) for fault in more)
    assert set(counts) == {kind for kind in Kind if KINDS[kind].of_clients}
    assert min(counts.values()) > 150 and max(counts.values()) < 225


def test_fewer_nodes_are_lost_at_once_than_there_are_copies_or_a_rack_and_never_the_voter() -> None:
    for seed in range(300):
        for fault in draw(seed, KEEPING):
            if KINDS[fault.kind].whom is Whom.COPIES:
                assert 1 <= len(fault.slots) <= 2 and VOTER not in fault.slots
            if KINDS[fault.kind].whom is Whom.RACK:
                assert fault.slots in (rack(1, 3, 5), rack(2, 3, 5))


def test_who_stands_in_no_rack_loses_none() -> None:
    schedules = [draw(seed, Climate(5, copying=Copying(2, 2, 0))) for seed in range(100)]
    assert not any(fault.kind is Kind.LOST_RACK for schedule in schedules for fault in schedule)
