"""If one fails, a large read waits for its slowest source, asks for something twice in vain, or never ends."""

from __future__ import annotations

from random import Random

from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.ids import NodeId, SpaceId
from scenefold.client.shares import Shares, UsualBytes, crowded

OWNER, ONE, TWO = (NodeId(number) for number in (1, 2, 3))
ALL = (OWNER, ONE, TWO)


def shares(count: int, least: int = 8, most: int = 64) -> Shares:
    return Shares(dict.fromkeys(range(count), ALL), least, most)


def test_who_is_ready_takes_the_next_few_and_nobody_is_asked_for_the_same() -> None:
    left = shares(64)
    taken = [left.next_of(node, 0.0) for node in ALL]
    assert [len(part) for part in taken] == [10, 9, 8]
    assert sorted(index for part in taken for index in part) == list(range(27))
    while part := left.next_of(OWNER, 0.0):
        taken.append(part)
    assert sorted(index for part in taken for index in part) == list(range(64))
    assert not left.next_of(ONE, 0.0) and not left.is_over


def test_what_is_late_another_one_is_asked_for_as_well_and_each_of_them_once() -> None:
    left = shares(8)
    assert left.next_of(OWNER, 0.0) == list(range(8))
    assert not left.is_wanted_of(ONE, 0.9, 1.0)
    assert left.is_wanted_of(ONE, 1.0, 1.0)
    assert left.late_of(ONE, 1.0, 1.0) == list(range(8))
    assert not left.late_of(TWO, 1.5, 1.0), "another one has only just been asked"
    assert not left.late_of(OWNER, 9.0, 1.0)
    for index in range(8):
        left.came(index)
    assert left.is_over and not left.may_help(TWO)


def test_what_one_cannot_give_is_asked_of_the_next_and_never_of_itself() -> None:
    left = shares(3)
    left.next_of(ONE, 0.0)
    left.came(1)
    left.ended(ONE, [0, 1, 2])
    assert not left.next_of(ONE, 0.0) and not left.may_help(ONE)
    assert left.next_of(TWO, 0.0) == [0, 2]
    left.ended(TWO, [0, 2])
    assert left.next_of(OWNER, 0.0) == [0, 2]
    left.ended(OWNER, [0, 2])
    assert not any(map(left.may_help, ALL)) and not left.is_over


def test_what_only_the_owner_may_say_nobody_else_is_asked_for() -> None:
    left = shares(2)
    left.only_of(OWNER, 0)
    assert left.next_of(ONE, 0.0) == [1]
    assert left.next_of(OWNER, 0.0) == [0]


@given(st.integers(1, 100), st.integers(1, 9), st.integers())
def test_as_long_as_one_of_them_answers_everything_comes(count: int, least: int, seed: int) -> None:
    dice = Random(seed)
    left, sound, now, asked = shares(count, least), 1 + dice.randrange(2), 0.0, set[tuple[NodeId, int]]()
    while not left.is_over:
        now += 1.0
        node = ALL[dice.randrange(3)]
        part = left.next_of(node, now) or left.late_of(node, now, 5.0)
        assert not asked & {(node, index) for index in part}
        asked |= {(node, index) for index in part}
        if node == ALL[sound]:
            for index in part:
                left.came(index)
        if dice.random() < 0.5:
            left.ended(node, part)
        assert now < 10_000


def test_who_has_more_than_twice_its_part_of_a_call_is_crowded() -> None:
    assert crowded({OWNER: 64}, 3, 16) == {OWNER}
    assert crowded({OWNER: 15}, 3, 16) == set()
    assert crowded({OWNER: 20, ONE: 21, TWO: 19}, 3, 16) == set()
    assert crowded({OWNER: 40, ONE: 10}, 5, 16) == {OWNER}
    assert crowded({}, 0, 16) == set()


def test_what_is_usual_follows_what_was_read() -> None:
    usual, space = UsualBytes(60_000.0), SpaceId(7)
    assert usual.count(space, 600_000) == 10
    usual.saw(space, [])
    usual.saw(space, [6_000, 2_000])
    assert usual.count(space, 40_000) == 10
    for _ in range(20):
        usual.saw(space, [40])
    assert usual.count(space, 40_000) > 900
