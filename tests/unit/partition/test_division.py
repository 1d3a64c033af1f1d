"""If this fails, nodes of a job disagree about who is in which render pool, or a lost node's pool has holes."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import LocalFault, PeerFault
from scenefold.base.limits import POOL_NODES_MAX
from scenefold.partition import Partition
from scenefold.partition.division import Division
from scenefold.wire import pack_value, unpack_value


def cells(nodes: int, epoch: int = 1) -> Partition:
    return Partition.voronoi([[float(node), 0.0, 0.0] for node in range(nodes)], epoch=epoch)


SIZES = st.lists(st.integers(1, 5), min_size=1, max_size=6)


@given(SIZES)
def test_pools_follow_one_another_and_every_place_is_in_one(sizes: list[int]) -> None:
    division = Division(tuple(map(cells, sizes)))
    assert division.nodes == sum(sizes)
    assert [len(places) for places in division.ranges] == sizes
    assert [place for places in division.ranges for place in places] == list(range(sum(sizes)))
    for place in range(sum(sizes)):
        assert place in division.ranges[division.pool_at(place)]


@given(SIZES, st.integers(1, 2**63 - 1))
def test_what_is_sent_comes_as_it_was(sizes: list[int], epoch: int) -> None:
    division = Division.of([cells(size) for size in sizes], epoch)
    assert Division.from_document(unpack_value(pack_value(division.to_document()), what="a division")) == division


def test_one_pool_looks_as_its_partition_does() -> None:
    assert Division((cells(3),)).to_document() == cells(3).to_document()


@given(SIZES, st.data())
def test_who_is_lost_leaves_cells_to_its_own_pool(sizes: list[int], data: st.DataObject) -> None:
    division = Division(tuple(map(cells, sizes)))
    gone = data.draw(st.sets(st.integers(0, division.nodes - 1), max_size=division.nodes - 1))
    after = division.without(gone, 7)
    assert after.epoch == 7 and after.nodes == division.nodes - len(gone)
    left = [[place for place in places if place not in gone] for places in division.ranges]
    assert [len(places) for places in after.ranges] == [len(places) for places in left if places]
    for partition, places, stay in zip(division.pools, division.ranges, left, strict=True):
        if stay:
            rows = partition.numbers.reshape(-1, 3)[[place - places.start for place in stay]]
            assert Partition.voronoi(rows, epoch=7) == after.pools[sum(1 for other in left[: left.index(stay)] if other)]


def test_nobody_is_left() -> None:
    with pytest.raises(LocalFault, match="nobody is left"):
        Division((cells(2), cells(1))).without({0, 1, 2}, 2)


@pytest.mark.parametrize(
    ("pools", "words"),
    [
        ((), "no pool"),
        ((cells(2), cells(2, epoch=2)), "several epochs"),
        ((cells(2, epoch=0),), "epoch 0"),
        ((cells(100), cells(POOL_NODES_MAX - 99)), "more than"),
    ],
)
def test_what_is_no_division_is_none(pools: tuple[Partition, ...], words: str) -> None:
    with pytest.raises(LocalFault, match=words):
        Division(pools)
    with pytest.raises(PeerFault, match=words):
        Division.from_document({"pools": [one.to_document() for one in pools]})


@pytest.mark.parametrize(
    "document", [None, {"pools": 3}, {"pools": [7]}, {"pools": [cells(1).to_document()] * 200}, {"pools": [], "epoch": 1}]
)
def test_what_comes_from_others_is_judged(document: object) -> None:
    with pytest.raises(PeerFault):
        Division.from_document(document)
