"""If this fails, a lost record is excused though a disk holds it, or blamed though none does."""

from __future__ import annotations

from scenefold.simulation.custody import Lost, lost_by_change, lost_to_claimer, newest
from scenefold.simulation.history import Place, Version

HERE, THERE = Place(1, 1, b"a" * 20), Place(1, 1, b"b" * 20)


def version(number: int) -> Version:
    return Version((1, number, 1, 1, bytes([number])), bytes([number]))


ONE, TWO, THREE = version(1), version(2), version(3)


def test_the_only_copy_goes_with_its_disk() -> None:
    now: dict[int, dict[Place, Version]] = {0: {}, 1: {}}
    assert lost_by_change({HERE: ONE}, now, now) == [Lost(HERE, (), ONE)]


def test_a_copy_elsewhere_of_the_same_version_is_no_loss() -> None:
    now = {0: {}, 1: {HERE: TWO}}
    assert lost_by_change({HERE: TWO}, now, now) == []


def test_a_copy_that_is_about_to_be_deleted_is_one_yet_may_come_back() -> None:
    assert lost_by_change({HERE: TWO}, {0: {}, 1: {}}, {0: {}, 1: {HERE: TWO}}) == [Lost(HERE, (TWO,), TWO)]


def test_an_older_copy_elsewhere_is_what_is_left() -> None:
    now = {0: {}, 1: {HERE: ONE}}
    assert lost_by_change({HERE: TWO}, now, now) == [Lost(HERE, (ONE,), TWO)]


def test_an_old_copy_that_goes_is_no_loss() -> None:
    now = {0: {}, 1: {HERE: TWO}}
    assert lost_by_change({HERE: ONE}, now, now) == []


def test_a_backup_brings_back_what_it_has() -> None:
    now = {0: {HERE: ONE, THERE: ONE}}
    assert lost_by_change({HERE: THREE, THERE: ONE}, now, now) == [Lost(HERE, (ONE,), THREE)]


def test_a_claimer_that_has_the_newest_excuses_nothing() -> None:
    disks = {0: {HERE: TWO}, 1: {HERE: TWO, THERE: ONE}}
    assert lost_to_claimer(disks, 1, [HERE, THERE]) == []


def test_a_claimer_without_it_loses_it_until_it_is_offered() -> None:
    disks = {0: {HERE: TWO}, 1: {HERE: ONE}, 2: {}}
    assert lost_to_claimer(disks, 1, [HERE]) == [Lost(HERE, (ONE, TWO), TWO)]
    assert lost_to_claimer(disks, 2, [HERE, THERE]) == [Lost(HERE, (ONE, TWO), TWO)]


def test_the_newest_is_the_highest_not_the_last() -> None:
    assert newest([{HERE: TWO}, {HERE: ONE}, {}], HERE) == TWO
    assert newest([{}, {}], HERE) is None
