"""If this fails, two nodes that were sent one partition could disagree about who owns a point."""

from __future__ import annotations

import dataclasses
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import LocalFault, PeerFault
from scenefold.partition import Family, Partition, camera_frame, even_bounds
from scenefold.partition.boxes import Cut
from unit.partition.cells import partitions

FRAME = camera_frame([0, 0, 0], [0, 0, -1], [0, 1, 0])
WEDGES = Partition.wedges(FRAME, even_bounds(5), epoch=7)


@given(partitions(), st.integers(0, 2**63 - 1))
def test_a_document_carries_every_bit(case, epoch):
    partition = dataclasses.replace(case[0], epoch=epoch)
    document = partition.to_document()
    assert all(type(value) in (int, bytes) for value in document.values())
    again = Partition.from_document(document)
    assert again == partition
    assert hash(again) == hash(partition)
    assert again.kernel_data().tobytes() == partition.kernel_data().tobytes()
    assert partition != dataclasses.replace(partition, epoch=epoch ^ 1)


def test_zero_has_one_form():
    assert Partition.voronoi([[0.0, 0, 0]]) == Partition.voronoi([[-0.0, 0, -0.0]])


def test_kernel_data_is_ones_own():
    WEDGES.kernel_data()[:] = 0
    assert WEDGES.kernel_data().any()
    with pytest.raises(ValueError):
        WEDGES.numbers[0] = 1.0


@pytest.mark.parametrize(
    "change",
    [
        {"epoch": -1},
        {"epoch": 2**63},
        {"epoch": True},
        {"epoch": 1.0},
        {"family": 0},
        {"family": True},
        {"family": "voronoi"},
        {"nodes": 0},
        {"nodes": 128},
        {"nodes": 4},
        {"nodes": True},
        {"values": b""},
        {"values": "x" * 104},
        {"values": None},
        {"more": 1},
    ],
)
def test_a_document_that_is_no_partition_is_the_peers_fault(change):
    with pytest.raises(PeerFault):
        Partition.from_document({**WEDGES.to_document(), **change})


@pytest.mark.parametrize("document", [None, [], {}, {"epoch": 1}])
def test_what_is_no_document_is_the_peers_fault(document):
    with pytest.raises(PeerFault):
        Partition.from_document(document)


@pytest.mark.parametrize(
    ("place", "number"), [(0, np.nan), (1, np.inf), (2, 1e101), (0, -0.0), (3, 0.5), (9, 0.5), (9, 0.0), (9, -0.1), (12, 1.0), (10, 0.1)]
)
def test_numbers_that_make_no_wedges_are_refused(place, number):
    numbers = WEDGES.numbers.copy()
    numbers[place] = number
    with pytest.raises(PeerFault):
        Partition.from_document({**WEDGES.to_document(), "values": numbers.astype("<f8").tobytes()})


def test_a_wedge_wider_than_half_a_turn_is_refused():
    with pytest.raises(LocalFault, match="convex"):
        Partition.wedges(FRAME, [0.1, 0.7])
    with pytest.raises(LocalFault, match="half a turn each"):
        Partition.wedges(FRAME, [0.4])


def test_arrays_of_the_wrong_shape_are_refused():
    with pytest.raises(LocalFault):
        WEDGES.owner([0.0, 0, 0])
    with pytest.raises(LocalFault):
        WEDGES.owner([[0.0, 0, 0]], [[0.0, 0, 0]] * 2)
    with pytest.raises(LocalFault):
        WEDGES.exit([[0.0, 0, 0]], [[1.0, 0, 0]], 0.0, 5)
    assert len(WEDGES.owner(np.zeros((0, 3)))) == 0


def test_the_families_numbers_stand():
    assert {family.name: int(family) for family in Family} == {"VORONOI": 1, "WEDGES": 2, "SLABS": 3, "POWER": 4, "BOXES": 5}


def test_importing_cells_does_not_import_numba():
    check = "import sys, scenefold.partition; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", check], check=False).returncode == 0


def test_kernels_of_others_call_the_scalar_functions():
    from numba import njit

    from scenefold.partition import kernels

    owner_at, owner_ahead, exit_after = kernels.owner_at, kernels.owner_ahead, kernels.exit_after
    leave_after, cell_meets_box = kernels.leave_after, kernels.cell_meets_box

    @njit("Tuple((int32, int32, float64, float64, int32, boolean))(int32, float64[:, ::1])", nogil=True)
    def walk(family, data):
        node = owner_at(family, data, 1.0, 0.5, 0.0)
        ahead = owner_ahead(family, data, 0.0, 0.0, 0.0, 1.0, 0.5, 0.0)
        t = exit_after(family, data, node, 1.0, 0.5, 0.0, -1.0, 0.0, 0.0, 0.0)
        t_exit, target = leave_after(family, data, node, 1.0, 0.5, 0.0, -1.0, 0.0, 0.0, 0.0)
        meets = cell_meets_box(family, data, node, 0.9, 0.4, -0.1, 1.1, 0.6, 0.1, 0.0)
        return node, ahead, t, t_exit, target, meets

    four = Partition.wedges(FRAME, even_bounds(4))
    assert walk(np.int32(four.family), four.kernel_data()) == (0, 0, 1.0, 1.0, 3, True)


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: Partition.slabs(FRAME, [1.0, 0.5]), "descend"),
        (lambda: Partition(1, Family.SLABS, 1, np.array([0, 0, 0, 1, 1, 0.0]).tobytes()), "unit"),
        (lambda: Partition.power([[0, 0, 0]], [1.0, 2.0]), "weights"),
        (lambda: Partition.power([[0, 0, 0]], [np.inf]), "finite"),
        (lambda: Partition.boxes([Cut(3, 0.0, 1)]), "axis"),
        (lambda: Partition.boxes([Cut(0, 0.0, 2)]), "each side"),
        (lambda: Partition.boxes([Cut(0, 0.0, 1), Cut(0, 0.5, 2)]), "each side"),
        (lambda: Partition.boxes([Cut(0, 0.0, 1), Cut(0, 0.5, 0)]), "each side"),
        (lambda: Partition.boxes([Cut(0, 0.0, 1), Cut(0, -0.5, 1)]), "outside"),
    ],
)
def test_numbers_that_make_no_cells_are_refused(make, match):
    with pytest.raises(LocalFault, match=match):
        make()
