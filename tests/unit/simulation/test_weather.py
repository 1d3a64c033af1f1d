"""If this fails, schedules are not what a seed says, or a kind of fault hardly ever comes."""

from __future__ import annotations

from collections import Counter

import pytest

from scenefold.simulation.faults import KINDS, Kind, Whom
from scenefold.simulation.weather import FAULTS_MIN, Climate, draw, spares_of

FIVE = Climate(5)


def test_a_thousand_seeds_have_five_hundred_of_each_kind_with_room_to_spare() -> None:
    counts = Counter(fault.kind for seed in range(1000) for fault in draw(seed, FIVE))
    assert {kind: counts[kind] for kind in Kind if counts[kind] < 600} == {}


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


@pytest.mark.parametrize("nodes", [3, 4, 7, 50])
def test_any_size_can_be_drawn(nodes: int) -> None:
    for seed in range(50):
        for fault in draw(seed, Climate(nodes)):
            assert len(set(fault.slots)) == len(fault.slots)
            if KINDS[fault.kind].whom is Whom.GROUP:
                assert 0 < len(fault.slots) * 2 < nodes + 1


def test_a_fault_reads_like_a_sentence() -> None:
    lines = {fault.kind: str(fault) for seed in range(30) for fault in draw(seed, FIVE)}
    assert set(lines) == set(Kind)
    assert all(kind.value in line for kind, line in lines.items())
