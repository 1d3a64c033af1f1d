"""If this fails, a node that knows its neighbours alone leaves them more than it should, or a hole (Algorithm 3)."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import LocalFault
from scenefold.partition.local_bounds import agree, withdraw
from unit.partition.cells import SEEDS


def test_a_node_with_no_more_than_its_share_stays():
    assert withdraw(0.0, 1.0, [1, 1], 2.0) == (0.0, 1.0)
    assert withdraw(0.0, 1.0, [0, 0], 0.0) == (0.0, 1.0)


def test_the_fullest_bin_grows_left_to_half_the_mean_and_right_to_the_mean():
    # Mean 10: bin 3 has 3; with bin 2 it has 4, and bin 1 would make 6, over 5. Right: 3 more is 7, then 3 of 6.
    assert withdraw(0.0, 8.0, [5, 2, 1, 8, 3, 6, 4, 1], 20.0) == pytest.approx((2.0, 6.5))
    assert withdraw(0.0, 8.0, [5, 2, 1, 30, 3, 6, 4, 1], 20.0) == (3.0, 4.0)
    assert withdraw(0.0, 4.0, [2, 2, 2, 5], 6.0) == pytest.approx((2.5, 4.0))


def test_next_to_a_fixed_bound_a_span_begins_there():
    assert withdraw(0.0, 4.0, [2, 2, 2, 5], 5.0, fixed_low=True) == pytest.approx((0.0, 2.5))
    assert withdraw(0.0, 4.0, [2, 2, 2, 5], 5.0, fixed_high=True) == pytest.approx((3.0, 4.0))
    assert withdraw(0.0, 4.0, [2, 2, 2, 5], 5.0, fixed_low=True, fixed_high=True) == (0.0, 4.0)


@given(SEEDS, st.booleans(), st.booleans())
def test_a_span_only_shrinks_and_holds_about_the_mean(seed, fixed_low, fixed_high):
    rng = np.random.default_rng(seed)
    counts = rng.integers(0, 20, 64)
    mean = float(rng.uniform(0.2, 1.2)) * counts.sum()
    low, high = withdraw(2.0, 3.0, counts, mean, fixed_low=fixed_low, fixed_high=fixed_high)
    assert 2.0 <= low <= high <= 3.0
    edges = 2.0 + np.arange(65) / 64
    held = np.diff(np.interp([low, high], edges, np.concatenate([[0], np.cumsum(counts)])))[0]
    if counts.sum() > mean and not (fixed_low and fixed_high):
        assert held <= max(mean, counts.max()) + 1e-6
    else:
        assert (low, high) == (2.0, 3.0)


def test_what_is_said_becomes_bounds():
    old = [0.0, 1.0, 2.0, 3.0]
    assert agree(old, [None, None, None]).tolist() == old
    assert agree(old, [None, (1.25, 1.5), None]).tolist() == [0, 1.25, 1.5, 3]
    assert agree(old, [(0.0, 0.5), (1.25, 1.5), None]).tolist() == [0, 0.875, 1.5, 3]
    assert agree(old, [(0.0, 2.75), None, (1.0, 3.0)]).tolist() == [0, 2.75, 2.75, 3]
    assert agree(old, [(-5.0, 9.0), None, (-9.0, 5.0)]).tolist() == [0, 3, 3, 3]
    for wrong in ([None], []):
        with pytest.raises(LocalFault):
            agree(old, wrong)


@given(SEEDS)
def test_rounds_of_words_bring_shares_together(seed):
    rng = np.random.default_rng(seed)
    places, nodes = np.sort(rng.beta(2, 5, 4000)), 6
    bounds = np.arange(nodes + 1) / nodes

    def counts(edges: np.ndarray) -> np.ndarray:
        return np.histogram(places, edges)[0]

    before, best = counts(bounds).max(), np.inf
    for _ in range(40):
        held, words = counts(bounds), []
        for i in range(nodes):
            around = held[max(i - 1, 0) : i + 2].mean()
            bins = np.histogram(places, np.linspace(bounds[i], bounds[i + 1], 65))[0] if bounds[i + 1] > bounds[i] else np.zeros(64)
            word = withdraw(bounds[i], bounds[i + 1], bins, around, fixed_low=i == 0, fixed_high=i == nodes - 1)
            words.append(word if word != (bounds[i], bounds[i + 1]) else None)
        bounds = agree(bounds, words)
        best = min(best, counts(bounds).max())
    assert best < 0.95 * before
