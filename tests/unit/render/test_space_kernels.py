"""If this fails, rays get stuck between cells, skip what they should hit, or hit the surface that they leave."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from unit.render import probe_kernels as probe

LOW, HIGH = np.array([-1.0, -2.0, 0.5]), np.array([3.0, 1.0, 4.0])
RANDOM = np.random.default_rng(3)

steps = st.integers(0, 65_535)
starts = st.floats(0.0, 1e6, allow_subnormal=False)
lengths = st.floats(1e-6, 1e6)


def test_spans_are_where_a_line_is_in_the_box() -> None:
    origins, ways = RANDOM.uniform(-6, 6, (20_000, 3)), RANDOM.normal(size=(20_000, 3))
    inside = probe.spans(origins, ways, LOW, HIGH)
    hit = inside[:, 0] <= inside[:, 1]
    assert 0.05 < hit.mean() < 0.95
    for share in (0.001, 0.5, 0.999):
        t = inside[hit, 0] + (inside[hit, 1] - inside[hit, 0]) * share
        points = origins[hit] + ways[hit] * t[:, None]
        assert ((points > LOW - 1e-9) & (points < HIGH + 1e-9)).all()
    for t in (inside[hit, 1] * (1 + 1e-6) + 1e-9, inside[hit, 0] * (1 - 1e-6) - 1e-9):
        ahead = t >= 0
        points = (origins[hit] + ways[hit] * t[:, None])[ahead]
        assert ((points <= LOW) | (points >= HIGH)).any(axis=1).all()
    missed = origins[~hit, None, :] + ways[~hit, None, :] * np.linspace(0, 20, 400)[None, :, None]
    assert not ((missed > LOW + 1e-6) & (missed < HIGH - 1e-6)).all(axis=2).any()


def test_spans_along_axes_and_faces() -> None:
    origins = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [-1.0, 0.0, 1.0], [5.0, 0.0, 1.0], [3.0, 1.0, 4.0]])
    ways = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, -0.0]])
    spans = probe.spans(origins, ways, LOW, HIGH)
    assert spans[0].tolist() == [0.5, 4.0]
    assert spans[1, 0] > spans[1, 1], "parallel to the box, beside it"
    assert spans[2].tolist() == [0.0, 1.0], "within a face is within the box"
    assert spans[3, 0] > spans[3, 1]
    assert spans[4].tolist() == [0.0, 4.0]


@given(starts, lengths, steps, st.floats(-0.5, 1.5))
def test_steps_rise_and_cover_the_place_that_was_asked_for(start: float, length: float, step: int, share: float) -> None:
    end = start + length
    assume(step < 65_535 and end > start)
    t = start + share * length
    following, place = probe.next_step(t, start, end, step)
    assert step < following <= 65_535
    # The last step lies at the end; beyond it nothing is asked for.
    assert following == 65_535 or place >= t - 4e-16 * max(abs(t), end)
    assert place >= probe.place_of_step(step, start, end)
    if following > step + 1:
        before = probe.place_of_step(following - 1, start, end)
        assert before < t + 4e-16 * max(abs(t), end), "the first such step, not a later one"


@given(starts, lengths, steps)
def test_a_ray_gets_through_in_as_many_hops_as_there_are_cells(start: float, length: float, step: int) -> None:
    end = start + length
    assume(end > start)
    hops = 0
    while step < 65_535 and hops < 3:
        step, _ = probe.next_step(math.inf if hops == 2 else start, start, end, step)
        hops += 1
    assert step == 65_535 or hops == 3


def test_strange_spans_end_at_once() -> None:
    for t, start, end in ((math.inf, 0.0, 1.0), (0.5, 1.0, 0.0), (0.0, 0.0, 0.0), (math.nan, 0.0, 1.0), (0.0, 0.0, math.nan)):
        assert probe.next_step(t, start, end, 7)[0] == 65_535


def test_offsets_move_away_from_the_surface_at_any_size_of_surface() -> None:
    normals = RANDOM.normal(size=(20_000, 3))
    normals[:3] = np.eye(3)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    for size in (1e-6, 1e-2, 1.0, 1e5):
        for far in (0.0, 1.0, 1e3):
            points = RANDOM.uniform(-1, 1, normals.shape) * size * max(far, 0.5)
            points[::7, 1] = 0.0
            moved = probe.offsets(points, normals, size).astype(np.float64)
            along = ((moved - points) * normals).sum(axis=1)
            reach = np.abs(points).max(axis=1)
            assert (along > 0.5 * (size * 2.0**-18 + reach * 2.0**-20)).all(), "beyond all rounding"
            assert (along < 2.0 * (size * 2.0**-18 + reach * 2.0**-20)).all(), "and no further"
