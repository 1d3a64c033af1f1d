"""If this fails, cells move at the wrong time, by the wrong figures, or a node's sample of hits is unfair or without bound."""

from __future__ import annotations

from collections.abc import Mapping
from typing import cast

import numpy as np
import pytest
import trio

from scenefold.base.errors import LocalFault, PeerFault, UsageFault
from scenefold.base.rays import RAY_WORDS
from scenefold.partition import Partition, camera_frame
from scenefold.partition.division import Division
from scenefold.partition.registry import BUILT_IN
from scenefold.partition.rules import Measured
from scenefold.render.algorithms import ALGORITHMS, RESTING, WHOLE, check_algorithm, rule_of
from scenefold.render.pool.division_moves import DivisionMoves
from scenefold.render.pool.hit_sample import KEPT_LEAST, KEPT_OF_ALL, HitSample, hits_of_bytes, kept_of
from scenefold.render.pool.mover import Mover
from scenefold.render.pool.moves import Moves, Told
from scenefold.render.pool.work import WorkQueue
from scenefold.world import Clock, Workers
from unit.inline_workers import InlineWorkers
from unit.peer.balance.street import TrioClock

BOX = np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])
FRAME = camera_frame([0, 0, 0], [0, 0, -1], [0, 1, 0])
NOWHERE = np.zeros((0, 2, 3))


def _told(casts: int, seconds: float, hits: object = ()) -> Told:
    return Told(casts, seconds, np.asarray(hits, np.float32).reshape(-1, 3))


def test_rounds_double_and_are_counted_from_the_last_move() -> None:
    cells = Partition.boxes([])
    moves = Moves(lambda partition, _measured, _damping: partition, cells, BOX, NOWHERE, first_rays=100)
    assert not moves.is_due([_told(99, 1.0)]) and moves.is_due([_told(100, 1.0)])
    assert moves.next([_told(150, 1.0)]) is cells
    assert not moves.is_due([_told(349, 1.0)]) and moves.is_due([_told(350, 1.0)])


def test_what_better_cells_could_save_is_the_lead_of_the_busiest_since_the_last_move() -> None:
    moves = Moves(lambda partition, _measured, _damping: partition, Partition.boxes([]), BOX, NOWHERE, first_rays=1)
    assert moves.idle_share([_told(0, 0.0), _told(0, 0.0)]) == 0.0
    assert moves.idle_share([_told(9, 1.0), _told(9, 4.0)]) == 1 - 2.5 / 4
    moves = Moves(moves._rule, Partition.voronoi([[0, 0, 0], [1, 0, 0]]), BOX, NOWHERE, before=[_told(9, 1.0), _told(9, 4.0)])
    assert moves.idle_share([_told(9, 2.0), _told(9, 5.0)]) == 0.0
    assert moves.idle_share([_told(9, 2.0), _told(9, 4.0)]) == 0.5


@pytest.mark.parametrize(("left_s", "lead", "moved"), [(1000.0, 0.25, 2), (30.0, 0.25, 1), (1000.0, 0.0, 1)])
async def test_cells_stay_where_a_move_would_cost_more_than_it_wins(
    autojump_clock: trio.testing.MockClock, left_s: float, lead: float, moved: int
) -> None:
    """A move takes 10 s; one of two nodes works longer than the other one by so much of that one's time."""
    claimed: list[object] = []

    def told() -> list[Told]:
        now = trio.current_time()
        return [_told(int(now * 1e9), now), _told(int(now * 1e9), now * (1 + lead))]

    async def to_all(event: Mapping[str, object], _limit: float) -> None:
        await trio.sleep(5.0)
        claimed.extend([event["claim"]] if "claim" in event else [])

    def rule(partition: Partition, _measured: Measured, _damping: float) -> Partition:
        return Partition.voronoi([[0, 0, 0], [2 + partition.epoch, 0, 0]])

    moves = DivisionMoves(rule, Division((Partition.voronoi([[0, 0, 0], [1, 0, 0]]),)), BOX, NOWHERE, first_rays=1)
    clock = cast(Clock, TrioClock())
    mover = Mover(moves, clock, cast(Workers, InlineWorkers()), told, to_all, lambda: left_s, lambda _after, *, is_claimed: None)
    with trio.move_on_after(120.0):
        await mover.run()
    assert len(claimed) == moved


def test_hits_weigh_what_their_node_spends_on_one_and_loads_are_those_of_the_round() -> None:
    seen: list[Measured] = []

    def rule(partition: Partition, measured: Measured, _damping: float) -> Partition:
        seen.append(measured)
        return partition

    moves = Moves(rule, Partition.voronoi([[0, 0, 0], [1, 0, 0]]), BOX, NOWHERE, first_rays=1)
    moves.next([_told(10, 1.0, [[0, 0, 0], [0, 0, 1]]), _told(10, 9.0, [[1, 0, 0]])])
    moves.next([_told(20, 1.5, [[0, 0, 0], [0, 0, 1]]), _told(20, 9.0, [[1, 0, 0]])])
    assert seen[0].hit_weights is not None and seen[0].hit_weights.tolist() == [0.5, 0.5, 9.0]
    assert seen[0].loads.tolist() == [1.0, 9.0] and seen[1].loads.tolist() == [0.5, 0.0]


def test_free_algorithms_come_to_rest_and_fits_move_at_once() -> None:
    dampings: list[float] = []

    def rule(partition: Partition, _measured: Measured, damping: float) -> Partition:
        dampings.append(damping)
        return partition

    for cells in (Partition.voronoi([[0, 0, 0], [1, 0, 0]]), Partition.power([[0, 0, 0], [1, 0, 0]], [0, 0])):
        moves = Moves(rule, cells, BOX, NOWHERE)
        moves.next([_told(0, 0.0), _told(1 << 22, 0.0)])
        moves.next([_told(0, 0.0), _told(1 << 24, 0.0)])
    assert dampings == [0.5, 1 - 2.0**-4, 0.0, 0.0]


def test_every_built_in_algorithm_has_a_name_and_a_rule() -> None:
    assert set(ALGORITHMS) == {*BUILT_IN, RESTING, WHOLE}
    for name in ALGORITHMS:
        check_algorithm(name)
        assert (rule_of(name) is None) == (name in (RESTING, WHOLE))
    with pytest.raises(UsageFault, match="no algorithm 'spiral'"):
        check_algorithm("spiral")
    with pytest.raises(LocalFault):
        rule_of("spiral")


def test_a_sample_is_bounded_fair_and_travels() -> None:
    sample = HitSample(kept_of(4), 7)
    for turn in range(40):
        sample.add(np.full((200, 3), turn, np.float32), 12_800)
    hits = hits_of_bytes(sample.to_bytes(), kept_of(4))
    assert len(hits) == kept_of(4) == KEPT_OF_ALL // 4 and sample.count == 40 * 12_800
    # 1,024 of 8,000: of each turn about 25.6, four deviations are 19.
    counts = np.bincount(hits[:, 0].astype(int), minlength=40)
    assert counts.min() >= 6 and counts.max() <= 45
    assert kept_of(127) == KEPT_LEAST
    assert [kept_of(127, pool) for pool in (1, 2, 64)] == [512, 512, 64] and kept_of(4, 2) == KEPT_OF_ALL // 4


def test_what_is_no_place_is_left_out() -> None:
    sample = HitSample(kept_of(2), 1)
    sample.add(np.array([[np.nan, 0, 0], [1, 2, 3], [np.inf, 0, 0]], np.float32), 3)
    assert hits_of_bytes(sample.to_bytes(), kept_of(2)).tolist() == [[1, 2, 3]]


@pytest.mark.parametrize(
    "payload",
    [None, b"123", bytes(12 * (kept_of(2) + 1)), np.array([np.nan, 0, 0], "<f4").tobytes(), np.array([2e30, 0, 0], "<f4").tobytes()],
)
def test_a_sample_that_is_none_is_refused(payload: object) -> None:
    with pytest.raises(PeerFault):
        hits_of_bytes(payload, kept_of(2))


def test_rays_that_are_lent_or_drained_keep_their_pass_busy() -> None:
    queue = WorkQueue()
    rays = np.zeros((5, RAY_WORDS), np.uint32)
    queue.put(1, rays)
    queue.put(2, rays)
    queue.lend(3)
    drained = queue.drain()
    assert sorted(work.number for work in drained) == [1, 2] and len(queue) == 0 and queue.take() is None
    assert all(queue.is_busy(number) for number in (1, 2, 3))
    queue.put(1, rays)
    assert not queue.done(1), "some of it waits here again"
    assert queue.done(2) and queue.done(3)


def test_what_a_rule_gives_is_looked_at() -> None:
    cells = Partition.voronoi([[0, 0, 0], [1, 0, 0]], epoch=5)
    told = [_told(10, 1.0), _told(10, 1.0)]
    same = Moves(lambda partition, _measured, _damping: partition.with_epoch(9), cells, BOX, NOWHERE)
    assert same.next(told) is cells
    other = Moves(lambda _partition, _measured, _damping: Partition.slabs(FRAME, [0.5], epoch=1), cells, BOX, NOWHERE)
    assert other.next(told).epoch == 6
    wrong = Moves(lambda _partition, _measured, _damping: Partition.voronoi([[0, 0, 0]]), cells, BOX, NOWHERE)
    with pytest.raises(LocalFault, match="for 1 nodes, of 2"):
        wrong.next(told)
