"""If this fails, bounds wander among nodes that hold copies for each other, or a node that is nearly full is given more."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import pytest
import trio
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import Refused
from scenefold.base.ids import SceneId, SpaceId, address_of
from scenefold.base.location import FIRST, LAST, Arc, Location
from scenefold.base.reasons import RejectReason
from scenefold.peer.balance.load import (
    COUNT_AGAIN_S,
    HELD_COUNTS_FROM,
    HELD_COUNTS_WHOLE_FROM,
    RECOVERS_S_MAX,
    OwnLoad,
    Recovering,
    load_of,
    owned_share,
)
from scenefold.peer.balance.policy import FILL_MAX
from scenefold.peer.balance.seams import fill_of
from scenefold.peer.copies.custody import Custody
from scenefold.peer.copies.entries import Entry
from scenefold.peer.membership.status import OwnStatus
from scenefold.store.statistics import Counts, StoreStatistics
from scenefold.store.versions import RangeSum
from unit.peer.logs_made import member, node, secrets_of

MIB = 1 << 20
MIDDLE = Location.from_number(LAST.number // 2)
LEFT_HALF = Arc(FIRST, MIDDLE)
FIRST_SPACE, OTHER_SPACE = (SceneId(1), SpaceId(1)), (SceneId(1), SpaceId(2))
CAPACITIES = st.integers(1, 1 << 44)
SHARES = st.floats(0, 1)


@given(CAPACITIES, st.floats(0, HELD_COUNTS_FROM), SHARES)
def test_below_a_fill_only_what_is_owned_counts(capacity: int, fill: float, owned: float) -> None:
    used = int(capacity * fill)
    assert load_of(used, capacity, owned) == pytest.approx(used * owned, abs=1)


@given(st.integers(100, 1 << 44), st.floats(HELD_COUNTS_WHOLE_FROM, 1), SHARES)
def test_nobody_has_room_by_balance_who_has_none_on_the_disk(capacity: int, fill: float, owned: float) -> None:
    used = int(capacity * fill) + 1
    assert load_of(used, capacity, owned) == used
    assert used >= capacity * FILL_MAX


@given(CAPACITIES, st.floats(0, 1), st.floats(0, 0.01), SHARES)
def test_more_on_the_disk_is_never_less_and_never_a_leap(capacity: int, fill: float, more: float, owned: float) -> None:
    before, after = (load_of(int(capacity * part), capacity, owned) for part in (fill, min(fill + more, 1)))
    assert 0 <= before <= after + 1
    assert after - before <= 12 * more * capacity + 12


@given(st.integers(0, 1 << 44), CAPACITIES)
def test_who_owns_all_is_as_full_as_the_disk(used: int, capacity: int) -> None:
    assert load_of(used, capacity, 1.0) == used
    assert load_of(used, 0, 0.5) == used


def test_a_share_goes_by_the_bytes_of_each_space() -> None:
    spaces = {FIRST_SPACE: Counts(100, 1_000), OTHER_SPACE: Counts(10, 9_000)}
    assert owned_share(spaces, {FIRST_SPACE: 100}) == pytest.approx(0.1)
    assert owned_share(spaces, {FIRST_SPACE: 50, OTHER_SPACE: 5}) == pytest.approx(0.5)
    assert owned_share(spaces, {FIRST_SPACE: 200, OTHER_SPACE: 20}) == 1.0, "what was written since counts no more than all"
    assert owned_share({}, {}) == 1.0


class Disk:
    """A store with records of one size in two spaces, at some places."""

    def __init__(self) -> None:
        self.now = 0.0
        self.places: dict[Any, list[Location]] = {FIRST_SPACE: [], OTHER_SPACE: []}
        self.size = 1_000
        self.walks: list[Arc] = []
        self.asked: list[Any] = []
        self.is_damaged = False
        self.arc: Arc | None = LEFT_HALF
        self.custody = Custody((Entry((Location(b"\x55" * 20),), Arc(MIDDLE, LAST), 1, (member(1),), 1, whole=True),))
        clock: Any = SimpleNamespace(now=lambda: self.now)
        self.is_leaving = False
        self.recovers = False
        self.load = OwnLoad(clock, self, lambda: self.arc, lambda: self.custody, 0, lambda: self.is_leaving, lambda: self.recovers)

    def write(self, space: Any, count: int, arc: Arc) -> None:
        self.places[space] += [Location.from_number(arc.first.number + arc.length * index // count) for index in range(count)]

    async def statistics(self) -> StoreStatistics:
        spaces = {space: Counts(len(found), len(found) * self.size) for space, found in self.places.items() if found}
        total = sum(spaces.values(), Counts())
        return StoreStatistics(total.records, total.bytes, spaces, 2 * total.bytes, 1 << 40)

    async def arc_totals(self, arc: Arc) -> Counts:
        self.walks.append(arc)
        count = sum(place in arc for found in self.places.values() for place in found)
        return Counts(count, count * self.size)

    async def sums(self, scene: SceneId, space: SpaceId, arcs: Sequence[Arc]) -> list[RangeSum]:
        if self.is_damaged:
            raise Refused(RejectReason.STORAGE_FULL, "no room for a tree")
        self.asked.append((scene, space))
        return [RangeSum(sum(place in arc for place in self.places[scene, space])) for arc in arcs]

    async def used(self) -> int:
        return (await self.load.look())[0]


@pytest.fixture(params=[0, 1 << 20], ids=["by the tree", "by a walk"])
def disk(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Disk:
    monkeypatch.setattr("scenefold.peer.balance.load.WALKED_RECORDS_MAX", request.param)
    found = Disk()
    found.write(FIRST_SPACE, 10, LEFT_HALF)
    found.write(FIRST_SPACE, 30, Arc(MIDDLE.next() or LAST, LAST))
    return found


def test_what_is_held_does_not_count_and_a_bound_that_moved_shows_at_once(disk: Disk) -> None:
    async def main() -> None:
        assert await disk.load.look() == (20_000, 1 << 40)
        disk.arc = Arc(FIRST, LAST)
        assert await disk.used() == 80_000
        disk.arc = None
        assert await disk.used() == 0

    trio.run(main)


def test_who_leaves_has_no_more_than_it_uses(disk: Disk) -> None:
    async def main() -> None:
        disk.is_leaving = True
        assert await disk.load.look() == (20_000, 20_000)
        disk.is_leaving = False
        assert await disk.load.look() == (20_000, 1 << 40)

    trio.run(main)


def test_what_was_recovered_shows_at_once(disk: Disk) -> None:
    async def main() -> None:
        disk.recovers = True
        assert await disk.used() == 20_000
        disk.write(OTHER_SPACE, 40, LEFT_HALF)
        assert await disk.used() == 20_000
        disk.recovers = False
        assert await disk.used() == 100_000

    trio.run(main)


def test_what_is_being_recovered_keeps_balance_away_for_a_while_and_again_the_next_time() -> None:
    now, gaps = [0.0], [1]
    clock: Any = SimpleNamespace(now=lambda: now[0])
    recovers = Recovering(clock, lambda: bool(gaps))
    assert recovers()
    now[0] = RECOVERS_S_MAX - 1
    assert recovers()
    now[0] = RECOVERS_S_MAX
    assert not recovers(), "who has to say what lies there may wait for balance"
    gaps.clear()
    assert not recovers()
    gaps.append(1)
    assert recovers()


def test_who_recovers_something_tells_nobody_how_full_it_seems() -> None:
    own = OwnStatus(node(1), address_of(node(1)), member(1).incarnation, 1, secrets_of(1))
    own.update(disk_used_bytes=4096, disk_total_bytes=8192)
    assert fill_of(own.signed()) == (4096, 8192)
    own.recovers = True
    assert own.fill == fill_of(own.signed()) == (0, 0)
    assert own.mini().offline_fraction == 0


def test_nothing_is_counted_where_nothing_is_held(disk: Disk) -> None:
    async def main() -> None:
        disk.custody = Custody()
        assert await disk.used() == 80_000
        assert not disk.walks
        assert not disk.asked

    trio.run(main)


def test_what_is_written_is_counted_after_a_while_and_nothing_twice(disk: Disk) -> None:
    async def main() -> None:
        await disk.used()
        disk.write(OTHER_SPACE, 40, LEFT_HALF)
        counted = len(disk.walks), len(disk.asked)
        assert await disk.used() == 20_000, "what has come since may be held for others"
        assert (len(disk.walks), len(disk.asked)) == counted
        disk.now += COUNT_AGAIN_S
        assert await disk.used() == 100_000
        again = len(disk.walks), len(disk.asked)
        assert sum(again) == sum(counted) + 1, "of the spaces only the one that has changed"
        disk.now += COUNT_AGAIN_S
        assert await disk.used() == 100_000
        assert (len(disk.walks), len(disk.asked)) == again

    trio.run(main)


def test_a_tree_that_cannot_be_made_anew_ends_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    async def main() -> None:
        monkeypatch.setattr("scenefold.peer.balance.load.WALKED_RECORDS_MAX", 0)
        disk = Disk()
        disk.write(FIRST_SPACE, 10, LEFT_HALF)
        disk.is_damaged = True
        assert await disk.used() == 20_000
        disk.is_damaged, disk.arc = False, Arc(FIRST, FIRST)
        assert await disk.used() == 2_000

    trio.run(main)
