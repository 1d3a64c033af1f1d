"""If this fails, the cell of a node that died belongs to nobody, or the others' cells move for no reason."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.base.errors import LocalFault
from scenefold.partition import Family, Partition
from scenefold.partition.dropped import without
from scenefold.partition.wedges import SPAN_MAX
from unit.partition.cells import partitions, points


@settings(deadline=None)
@given(partitions(), st.data())
def test_the_others_keep_what_they_have_and_share_the_rest(case: tuple[Partition, np.random.Generator], data: st.DataObject) -> None:
    partition, rng = case
    everybody = range(partition.nodes)
    gone = data.draw(st.sets(st.sampled_from(everybody), max_size=partition.nodes - 1))
    left = [node for node in everybody if node not in gone]
    after = without(partition, gone, partition.epoch + 3)
    assert (after.epoch, after.family, after.nodes) == (partition.epoch + 3, partition.family, len(left))
    places = points(partition, rng)
    before, now = partition.owner(places), after.owner(places)
    assert now.min() >= 0 and now.max() < len(left)
    # Wedges may have to give way, for none is wider than half a turn.
    if partition.family != Family.WEDGES or _are_narrow(after):
        owned = np.isin(before, left)
        assert (np.array(left)[now[owned]] == before[owned]).all()


def _are_narrow(partition: Partition) -> bool:
    spans = np.diff(np.concatenate([[0.0], partition.numbers[9:], [1.0]]))
    return partition.nodes > 2 and spans.max() < SPAN_MAX - 2**-30


@given(partitions())
def test_without_nobody_nothing_moves(case: tuple[Partition, np.random.Generator]) -> None:
    partition, _ = case
    assert without(partition, (), 9) == partition.with_epoch(9)


def test_a_wedge_that_would_be_too_wide_is_not() -> None:
    from scenefold.partition import camera_frame

    wide = Partition.wedges(camera_frame((0, 0, 0), (0, 0, 1), (0, 1, 0)), [0.3, 0.35, 0.7])
    after = without(wide, [1, 3], 2)
    assert after.nodes == 2 and after.numbers[9:].tolist() == [0.5]
    assert max(np.diff([0.0, *without(wide, [1], 2).numbers[9:], 1.0])) <= SPAN_MAX


def test_somebody_must_be_left_and_only_nodes_can_go() -> None:
    two = Partition.voronoi([[0, 0, 0], [1, 0, 0]])
    for gone in ([0, 1], [2], [-1]):
        with pytest.raises(LocalFault):
            without(two, gone, 2)
