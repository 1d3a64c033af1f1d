"""If this fails, storms of logs take away what no log stands, or nothing that one must stand."""

from __future__ import annotations

from collections import Counter

import pytest

from scenefold.simulation.faults import KINDS, VOTER, Kind
from scenefold.simulation.log_weather import COUNTS, deciders_of, first_deciders
from scenefold.simulation.outcome import FAULTS_MIN, Order

SEEDS = range(150)


def orders() -> list[Order]:
    return [Order(seed, nodes=max(5, deciders_of(seed)), workload="logs") for seed in SEEDS]


def test_seeds_have_all_numbers_of_participants() -> None:
    assert {order.deciders for order in orders()} == set(COUNTS)
    assert Order(0, workload="logs", participants=0).deciders == 0


def test_a_majority_keeps_its_disks() -> None:
    for order in orders():
        lost = {
            slot
            for fault in order.schedule
            for slot in fault.slots
            if fault.kind in (Kind.WIPED_DISK, Kind.DRAIN, Kind.RESTORED_BACKUP) or (fault.kind is Kind.CORRUPTION and slot != VOTER)
        }
        assert 2 * len(lost) < order.deciders


def test_also_who_takes_part_is_put_back_to_a_backup_but_once() -> None:
    hit = 0
    for order in orders():
        put_back = [slot for fault in order.schedule if fault.kind is Kind.RESTORED_BACKUP for slot in fault.slots]
        assert len(put_back) == len(set(put_back))
        first = first_deciders(order.seed, order.nodes, order.deciders)
        assert len(first) == order.deciders and set(first) <= set(range(order.nodes))
        hit += bool(set(first) & set(put_back))
    assert hit > len(SEEDS) // 5


def test_all_kinds_come_and_storms_stay_storms() -> None:
    counts = Counter(fault.kind for order in orders() for fault in order.schedule)
    whole = Counter(fault.kind for order in orders() for fault in Order(order.seed, nodes=order.nodes).schedule)
    assert set(counts) == set(whole) | {kind for kind in Kind if KINDS[kind].of_clients}
    assert all(counts[kind] == whole[kind] for kind in (Kind.PARTITION, Kind.CRASH, Kind.LOSS, Kind.ONE_WAY, Kind.PAUSE))
    assert min(len(order.schedule) for order in orders()) > FAULTS_MIN


@pytest.mark.parametrize("seed", [3, 4, 5])
def test_the_same_seed_has_the_same_participants(seed: int) -> None:
    order = Order(seed, nodes=7, workload="logs")
    assert first_deciders(seed, order.nodes, 3) == first_deciders(seed, order.nodes, 3)
