"""If this fails, whoever takes part in a render can fill a node's memory, or have it trace what is for others to deal."""

from __future__ import annotations

import numpy as np
import pytest

from scenefold.base.errors import PeerFault, Refused
from scenefold.base.limits import PASS_PATHS_MAX
from scenefold.base.rays import RAY_WORDS
from scenefold.render.passes import PassPlan
from scenefold.render.pool.incoming import check_room, check_senders
from scenefold.render.pool.outbox import Batch
from scenefold.render.pool.own_passes import NODES_MANY, owners_of, pass_owner, passes_in_flight

DEPTH = 8
PLAN = PassPlan(5, 200 * PASS_PATHS_MAX)


def batch(number: int, rays: int = 1) -> Batch:
    return Batch(0, number, np.zeros((rays, RAY_WORDS), np.uint32))


@pytest.mark.parametrize("nodes", [2, 5, NODES_MANY])
def test_rays_of_no_more_passes_than_may_be_open(nodes: int) -> None:
    most = 2 * nodes * passes_in_flight(nodes)
    check_room([batch(number) for number in range(most)], (), 0, nodes, DEPTH)
    check_room([batch(0), batch(0), batch(most - 1)], range(most), 0, nodes, DEPTH)
    with pytest.raises(PeerFault, match="more passes came than may be open"):
        check_room([batch(number) for number in range(most + 1)], (), 0, nodes, DEPTH)
    with pytest.raises(PeerFault, match="more passes came than may be open"):
        check_room([batch(3), batch(most)], range(most), 0, nodes, DEPTH)


def test_no_more_rays_than_open_passes_have() -> None:
    most = 3 * passes_in_flight(3) * PASS_PATHS_MAX * DEPTH
    check_room([batch(0, 100)], (), most - 100, 3, DEPTH)
    with pytest.raises(PeerFault, match="more rays came"):
        check_room([batch(0, 60), batch(1, 41)], (), most - 100, 3, DEPTH)
    check_room([], range(7), most + 1, 3, DEPTH)


def test_dealt_paths_come_from_who_owns_them() -> None:
    for number in range(20):
        owner = pass_owner(PLAN, number, 4)
        check_senders([batch(number)], PLAN, 4, owner)
        with pytest.raises(Refused, match="dealt by the owner"):
            check_senders([batch(number)], PLAN, 4, (owner + 1) % 4)
    check_senders([], PLAN, 4, 0)


@pytest.mark.parametrize("nodes", [1, 3, 127])
def test_owners_of_all_passes_at_once(nodes: int) -> None:
    assert owners_of(PLAN, nodes).tolist() == [pass_owner(PLAN, number, nodes) for number in range(PLAN.count)]


@pytest.mark.parametrize("plan", [PLAN, PassPlan(1, 7), PassPlan(2, 300_000, (27_648, 55_296, 110_592)), PassPlan(3, 65_536, (65_535,))])
def test_sizes_of_several_passes_at_once(plan: PassPlan) -> None:
    numbers = np.arange(plan.count)
    assert plan.sizes(numbers).tolist() == [plan.size(number) for number in range(plan.count)]
    assert plan.sizes(numbers).sum() == plan.paths
    assert plan.sizes(np.empty(0, np.int64)).tolist() == []
