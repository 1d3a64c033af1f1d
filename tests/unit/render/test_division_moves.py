"""If this fails, a render pool's cells follow the work of other pools, or do not follow their own."""

from __future__ import annotations

import numpy as np

from scenefold.partition import Partition
from scenefold.partition.division import Division
from scenefold.partition.rules import Measured
from scenefold.render.pool.division_moves import DivisionMoves
from scenefold.render.pool.moves import Told

BOX = np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])
NOWHERE = np.zeros((0, 2, 3))
TWO = Partition.voronoi([[0, 0, 0], [1, 0, 0]])
ONE = Partition.voronoi([[0, 0, 0]])
THREE = Partition.voronoi([[0, 0, 0], [1, 0, 0], [2, 0, 0]])


def told(casts: int, seconds: float) -> Told:
    return Told(casts, seconds, np.zeros((0, 3), np.float32))


def moves_of(rule: object, first_rays: int = 100) -> DivisionMoves:
    """Of pools of two, one and three nodes."""
    return DivisionMoves(rule, Division((TWO, ONE, THREE)), BOX, NOWHERE, first_rays)  # type: ignore[arg-type]


def test_each_pool_has_rounds_of_its_own_and_its_rule_hears_of_its_nodes_alone() -> None:
    heard: list[tuple[int, list[float]]] = []

    def rule(partition: Partition, measured: Measured, _damping: float) -> Partition:
        heard.append((partition.nodes, measured.loads.tolist()))
        return Partition.voronoi(np.arange(3.0 * partition.nodes).reshape(-1, 3))

    moves = moves_of(rule)
    few = [told(10, 1.0), told(10, 2.0), told(10_000, 3.0), told(10, 4.0), told(10, 5.0), told(10, 6.0)]
    assert not moves.is_due(few), "who is alone has no round, and the others' are not over"
    some = [*few[:3], told(50, 4.0), told(40, 5.0), told(10, 7.0)]
    assert moves.is_due(some)
    after = moves.next(some)
    assert heard == [(3, [4.0, 5.0, 7.0])]
    assert after.epoch == 2 and {one.epoch for one in after.pools} == {2}
    assert [one.values for one in after.pools[:2]] == [TWO.values, ONE.values] and after.pools[2].values != THREE.values
    moves.division = after
    assert moves.division is after and not moves.is_due(some)
    # The next one begins where all are.
    later = [told(100, 1.0), told(10, 2.0), *some[2:]]
    assert moves.next(later).epoch == 3 and heard[1] == (2, [1.0, 2.0])


def test_nothing_moves_where_no_rule_has_anything_to_say() -> None:
    moves = moves_of(lambda partition, _measured, _damping: partition)
    everybody = [told(1_000, 1.0)] * 6
    assert moves.next(everybody) is moves.division


def test_what_better_cells_could_save_is_that_of_the_pool_that_waits_most() -> None:
    moves = moves_of(lambda partition, _measured, _damping: partition)
    busy = [told(100, 1.0), told(100, 4.0), told(0, 99.0), told(100, 2.0), told(100, 2.0), told(100, 3.0)]
    assert moves.idle_share(busy) == 1 - 2.5 / 4
    # Only the last one's round is over.
    assert moves.idle_share([told(10, 1.0), told(10, 4.0), *busy[2:]]) == 1 - 7 / 9
    assert moves.idle_share([told(0, 0.0)] * 6) == 0.0
