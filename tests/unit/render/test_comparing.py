"""If this fails, renders are compared by figures that they do not have, or a file that is no report ends in a traceback."""

from __future__ import annotations

import json
from contextlib import suppress
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as some

from scenefold.base.errors import LocalFault
from scenefold.render.comparing import compared

SPATIAL: dict[str, Any] = {
    "partition": "spatial",
    "scene": "kitchen",
    "paths": 1000,
    "rays_passed_per_path": 0.5,
    "bytes_passed": 18_000,
    "efficiency": 0.75,
    "rounds": [{"cell_visits": 10, "efficiency": 0.5}, {"cell_visits": 20, "efficiency": 1.0}],
    "efficiency_of_rounds": 0.75,
    "cells_moved": 1,
    "tail": {"seconds_to_95": 8.0, "seconds_to_100": 10.0},
    "render_seconds": {"plan": 0.5, "prepare": 1.5, "render": 10.0, "merge": 0.25, "recover": 3.0},
    "render_nodes": [
        {"bytes_read": 100, "processor_seconds": 5.0, "memory_most": 1000},
        {"bytes_read": 200, "processor_seconds": 7.5, "memory_most": 3000},
    ],
    "image_sha256": "ab" * 32,
}
ODD = [None, True, -1, 1.5, float("nan"), float("inf"), "", "x", [], [1], {}, {"a": 1}, [None], 2**70]


def test_what_it_says_of_a_pool() -> None:
    run = compared(SPATIAL, "a.json")
    assert (run.report, run.partition, run.nodes, run.rounds, run.cells_moved) == ("a.json", "spatial", 2, 2, 1)
    assert run.seconds == 15.25, "no phase lies within another one"
    assert (run.processor_seconds, run.memory_most, run.bytes_read) == (12.5, 3000, 300)
    assert (run.transfers_per_path, run.bytes_per_path) == (0.5, 18.0)
    assert run.tail == 1.25
    assert json.loads(json.dumps(run.document()))["tail"] == 1.25


def test_what_an_earlier_report_does_not_say_is_not_known() -> None:
    rows = [{"bytes_read": 100}, {"bytes_read": 1}]
    keys = ("paths", "rays_passed_per_path", "bytes_passed", "efficiency", "render_seconds")
    run = compared({key: SPATIAL[key] for key in keys} | {"render_nodes": rows}, "old.json")
    assert (run.partition, run.bytes_read) == ("spatial", 101)
    assert {run.processor_seconds, run.memory_most, run.rounds, run.tail, run.image_sha256, run.scene} == {None}


@pytest.mark.parametrize("row", [{}, {"bytes_read": 5, "processor_seconds": 0.0, "memory_most": 0}])
def test_what_one_node_does_not_say_is_not_known_of_all(row: dict[str, Any]) -> None:
    """As where nodes of two versions have rendered together."""
    run = compared(SPATIAL | {"render_nodes": [SPATIAL["render_nodes"][0], row]}, "a.json")
    assert (run.processor_seconds, run.memory_most) == (None, None)
    assert run.bytes_read == (105 if row else None)


def test_figures_of_paths_are_of_those_that_this_run_traced() -> None:
    resumed = compared(SPATIAL | {"paths_before": 750, "rays_passed": 500}, "a.json")
    assert (resumed.paths, resumed.transfers_per_path, resumed.bytes_per_path) == (1000, 2.0, 72.0)


def test_a_render_within_a_budget_is_one_process() -> None:
    alone = {"render_nodes": [], "memory": {"budget": 5, "memory_most": 77}, "processor_seconds": {"render": 3.5}}
    run = compared(SPATIAL | alone, "alone.json")
    assert (run.partition, run.nodes, run.processor_seconds, run.memory_most, run.bytes_read) == ("out-of-core", 1, 3.5, 77, None)


@given(some.sampled_from(sorted(SPATIAL)), some.sampled_from(ODD))
def test_a_figure_of_another_kind_is_one_clear_error_or_none(key: str, odd: object) -> None:
    with suppress(LocalFault):
        json.dumps(compared(SPATIAL | {key: odd}, "a.json").document(), allow_nan=False)


@pytest.mark.parametrize("document", [None, [], "x", 5, {}, {"error": {"kind": "usage"}}, {"renders": []}, SPATIAL | {"render_nodes": "x"}])
def test_what_is_no_report(document: object) -> None:
    with pytest.raises(LocalFault, match="no report of a render"):
        compared(document, "x.json")


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"render_nodes": [5]}, "its 'render_nodes' cannot be [5]"),
        ({"memory": 5, "render_nodes": []}, "its 'memory' cannot be 5"),
        ({"tail": {"seconds_to_95": 1.0}}, "it has no 'seconds_to_100'"),
        ({"efficiency": "good"}, "its 'efficiency' cannot be 'good'"),
        ({"render_seconds": {"prepare": -1}}, "its 'render_seconds' cannot be {'prepare': -1}"),
        ({"rounds": 7}, "its 'rounds' cannot be 7"),
    ],
)
def test_what_is_wrong_with_a_report_is_named_by_its_key(change: dict[str, object], what: str) -> None:
    with pytest.raises(LocalFault) as refused:
        compared(SPATIAL | change, "a.json")
    assert refused.value.what == f"that is no report of a render: {what}"
