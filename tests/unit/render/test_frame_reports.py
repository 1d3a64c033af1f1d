"""If this fails, what several frames took together is not what each took, added up."""

from __future__ import annotations

from typing import Any

import pytest

from scenefold.render.comparing import compared
from scenefold.render.frame_reports import ROUNDS_MAX, report_of_frames

COUNTS = (
    "passes", "paths", "paths_before", "rays", "cell_visits", "cells_moved", "attempts", "begun", "passes_traced_again", "rays_passed",
    "packets_passed", "bytes_passed", "contributions_not_finite", "contributions_clamped",
)  # fmt: skip


def frame(*casts: int, rounds: int = 1, tail: dict[str, float] | None = None, **others: Any) -> dict[str, Any]:
    """The report of one; each node has cast so much."""
    usual = {
        **dict.fromkeys(COUNTS, 1),
        "paths": 100,
        "paths_before": 0,
        "cell_visits": sum(casts),
        "partition": "spatial",
        "numeric_class": "plain",
        "samples_per_pixel": 4.0,
        "paths_per_second": 1.0,
        "rays_per_second": 1.0,
        "pools": 1,
        "nodes_lost": [],
        "nodes_back": [],
        "rays_passed_per_path": 0.01,
        "efficiency": 1.0,
        "rounds": [{"cell_visits": 1, "efficiency": 1.0}] * rounds,
        "efficiency_of_rounds": sum(casts) / (len(casts) * max(*casts, 1)),
        "tail": tail,
        "render_seconds": {"plan": 0.1, "render": 2.0},
        "render_nodes": [
            {
                "address": f"127.0.0.{node + 2}",
                "casts": cast,
                "triangles": cast,
                "memory_most": 10 * cast,
                "busy_seconds": 0.1,
                "bytes_read": 7,
            }
            for node, cast in enumerate(casts)
        ],
        "left_out": [],
    }
    return usual | others


def test_counts_add_up_and_rates_are_of_all_of_the_time() -> None:
    both = report_of_frames([frame(30, 10, pools=2), frame(10, 30, rays=299, nodes_lost=["127.0.0.3"])])
    assert both["paths"] == 200 and both["rays"] == 300 and both["cell_visits"] == 80
    assert both["render_seconds"] == {"plan": 0.2, "render": 4.0}
    assert both["paths_per_second"] == 50.0 and both["rays_per_second"] == 75.0 and both["samples_per_pixel"] == 4.0
    assert both["pools"] == 2 and both["nodes_lost"] == ["127.0.0.3"] and both["rays_passed_per_path"] == 0.01
    # Each had as much to do in the end, and yet one waited for the other in each frame.
    assert both["efficiency"] == 1.0 and both["efficiency_of_rounds"] == pytest.approx(2 / 3)


def test_of_a_node_work_adds_up_and_what_it_held_is_the_most() -> None:
    both = report_of_frames([frame(30, 10), frame(10)])
    assert both["render_nodes"] == [
        {"address": "127.0.0.2", "casts": 40, "triangles": 30, "memory_most": 300, "busy_seconds": 0.2, "bytes_read": 14},
        {"address": "127.0.0.3", "casts": 10, "triangles": 10, "memory_most": 100, "busy_seconds": 0.1, "bytes_read": 7},
    ]


def test_a_tail_is_known_if_that_of_each_is_and_rounds_are_few() -> None:
    known = {"seconds_to_95": 0.5, "seconds_to_100": 0.75}
    assert report_of_frames([frame(1, tail=known), frame(1, tail=known)])["tail"] == {"seconds_to_95": 1.0, "seconds_to_100": 1.5}
    both = report_of_frames([frame(1, rounds=200, tail=known), frame(1, rounds=200)])
    assert both["tail"] is None and len(both["rounds"]) == ROUNDS_MAX


def test_it_is_a_report_like_others() -> None:
    one = compared(report_of_frames([frame(30, 10), frame(10, 30)]), "here")
    assert (one.nodes, one.paths, one.seconds, one.image_sha256) == (2, 200, pytest.approx(4.2), None)


def test_nothing_cast_is_no_division_by_nothing() -> None:
    nothing = report_of_frames([frame(0, efficiency_of_rounds=1.0)])
    assert nothing["efficiency"] == 1.0 and nothing["efficiency_of_rounds"] == 1.0
