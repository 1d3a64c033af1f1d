"""If this fails, `scenectl bench curve` has no figures, or wrong ones."""

from __future__ import annotations

import itertools

from scenefold.curve import CurveSpeed, hilbert_ratios, measure_curve


def test_rates_are_work_by_the_clock() -> None:
    ticks = itertools.count(0.0, 0.5)
    speed = measure_curve("hilbert", 3, lambda: next(ticks), points=100, boxes=4, limit=8)
    assert (speed.encode_points_s, speed.decode_points_s, speed.arcs_boxes_s) == (200.0, 200.0, 8.0)
    assert speed.arcs_limit == 8 and 1 <= speed.arcs_per_box <= 8


def test_ratios_need_both_curves() -> None:
    speeds = [
        CurveSpeed("hilbert", 3, 30.0, 1, 1, 1, 1),
        CurveSpeed("z-order", 3, 40.0, 1, 1, 1, 1),
        CurveSpeed("hilbert", 4, 9.0, 1, 1, 1, 1),
    ]
    assert hilbert_ratios(speeds) == {3: 0.75}
