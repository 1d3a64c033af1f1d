"""If this fails, wedges are unfair, concave or empty."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import LocalFault
from scenefold.partition import Partition, camera_frame, even_bounds, fit_bounds, histogram, limit_spans
from scenefold.partition.turns import cosine_and_sine
from scenefold.partition.wedges import SPAN_MAX, SPAN_MIN
from unit.partition.cells import NODES, SEEDS

FRAME = camera_frame([0, 0, 0], [0, 0, -1], [0, 1, 0])


def spans(bounds: np.ndarray) -> np.ndarray:
    return np.diff(np.concatenate([[0.0], bounds, [1.0]]))


@given(NODES, SEEDS)
def test_spans_are_limited_and_make_a_partition(nodes, seed):
    rng = np.random.default_rng(seed)
    bounds = limit_spans(np.sort(rng.choice([0.0, 0.3, 1.0, rng.uniform()], nodes - 1)))
    assert Partition.wedges(FRAME, bounds).nodes == nodes
    if nodes > 2:
        assert spans(bounds).max() <= SPAN_MAX + 1e-12
        assert spans(bounds).min() >= SPAN_MIN - 1e-12
        assert np.abs(limit_spans(bounds) - bounds).max() < 1e-12


@given(st.integers(3, 127), SEEDS)
def test_a_fit_gives_equal_shares_of_the_histogram(nodes, seed):
    counts = np.random.default_rng(seed).integers(50, 150, 4096)
    bounds = fit_bounds(counts, nodes)
    running = np.interp(np.concatenate([[0.0], bounds, [1.0]]), np.arange(4097) / 4096, np.concatenate([[0], np.cumsum(counts)]))
    assert np.allclose(np.diff(running) * nodes / counts.sum(), 1.0, atol=1e-9)


@given(st.integers(3, 40), SEEDS)
def test_where_all_work_lies_on_one_side_the_others_share_it(nodes, seed):
    """No other bounds that are allowed have a smaller largest share, up to the empty node's crumbs."""
    rng = np.random.default_rng(seed)
    counts = np.zeros(1024)
    start = rng.integers(0, 1024 - 200)
    counts[start : start + 200] = rng.integers(50, 150, 200)
    bounds = np.concatenate([[0.0], fit_bounds(counts, nodes), [1.0]])
    running = np.interp(bounds, np.arange(1025) / 1024, np.concatenate([[0], np.cumsum(counts)]))
    shares = np.diff(running) / counts.sum()
    assert np.diff(bounds).max() <= SPAN_MAX + 1e-12
    assert shares.max() <= 1.0 / (nodes - 2) + 1e-3


@given(SEEDS)
def test_a_histogram_forgets_the_order_of_its_samples(seed):
    rng = np.random.default_rng(seed)
    fractions, weights = rng.uniform(0, 1, 500), rng.exponential(1.0, 500)
    order = rng.permutation(500)
    assert (histogram(fractions, weights) == histogram(fractions[order], weights[order])).all()


def test_special_cases_of_a_fit():
    assert fit_bounds(np.zeros(16), 4).tolist() == [0.25, 0.5, 0.75]
    assert fit_bounds([1, 0, 0, 5], 1).tolist() == []
    assert fit_bounds([9, 0, 0, 0], 2).tolist() == [0.5]
    assert spans(fit_bounds([0, 9, 0, 0], 127)).max() <= SPAN_MAX
    for wrong in ([], [-1.0], [np.nan]):
        with pytest.raises(LocalFault):
            fit_bounds(wrong, 3)
    with pytest.raises(LocalFault):
        histogram([0.5], [-1.0])


def test_cosine_and_sine_of_turns():
    fractions = np.linspace(0, 1, 10_001)
    exact = np.array([cosine_and_sine(float(fraction)) for fraction in fractions])
    assert np.abs(exact[:, 0] - np.cos(2 * np.pi * fractions)).max() < 1e-15
    assert np.abs(exact[:, 1] - np.sin(2 * np.pi * fractions)).max() < 1e-15
    assert [cosine_and_sine(k / 4) for k in range(5)] == [(1, 0), (0, 1), (-1, 0), (0, -1), (1, 0)]
    assert cosine_and_sine(1 / 3)[1].hex() == "0x1.bb67ae8584cabp-1"
    assert even_bounds(4).tolist() == [0.25, 0.5, 0.75]
