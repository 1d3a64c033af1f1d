"""The reports of several frames as one: what they took together (docs/reference/scenectl.md, *Report of an image*). Pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

ROUNDS_MAX = 256
_SUMS = (
    "passes",
    "paths",
    "paths_before",
    "rays",
    "cell_visits",
    "cells_moved",
    "attempts",
    "begun",
    "passes_traced_again",
    "rays_passed",
    "packets_passed",
    "bytes_passed",
    "contributions_not_finite",
    "contributions_clamped",
)
_LISTS = ("nodes_lost", "nodes_back")
_OF_LARGEST = frozenset({"memory_most", "records", "groups", "triangles"})
"""Of a node: what it had at a time; everything else adds up."""


def report_of_frames(frames: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """As of one render that took all of their time, with the keys of each that have a meaning for all. `frames`: reports of `render_still`, one at least."""
    first, sums = frames[0], {name: sum(frame[name] for frame in frames) for name in _SUMS}
    seconds = _added(frame["render_seconds"] for frame in frames)
    nodes = _nodes(frames)
    rendering, traced = max(seconds.get("render", 0.0), 1e-9), sums["paths"] - sums["paths_before"]
    casts = [node["casts"] for node in nodes]
    return {
        "partition": first["partition"],
        "numeric_class": first["numeric_class"],
        **sums,
        "samples_per_pixel": sum(frame["samples_per_pixel"] for frame in frames) / len(frames),
        "paths_per_second": traced / rendering,
        "rays_per_second": sums["rays"] / rendering,
        "pools": max(frame["pools"] for frame in frames),
        **{name: [address for frame in frames for address in frame[name]] for name in _LISTS},
        "rays_passed_per_path": sums["rays_passed"] / max(traced, 1),
        "efficiency": sum(casts) / (len(casts) * max(casts)) if max(casts) else 1.0,
        "rounds": [row for frame in frames for row in frame["rounds"]][:ROUNDS_MAX],
        "efficiency_of_rounds": _efficiency_of_rounds(frames),
        "tail": _tail(frames),
        "render_seconds": seconds,
        "render_nodes": nodes,
        "left_out": first["left_out"],
    }


def _nodes(frames: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Of each node what it did for all frames, in the order in which they are first named."""
    rows: dict[str, list[Mapping[str, Any]]] = {}
    for frame in frames:
        for row in frame["render_nodes"]:
            rows.setdefault(row["address"], []).append(row)
    return [
        {
            "address": address,
            **{
                name: max(row[name] for row in some) if name in _OF_LARGEST else _rounded(sum(row[name] for row in some))
                for name in some[0]
                if name != "address"
            },
        }
        for address, some in rows.items()
    ]


def _efficiency_of_rounds(frames: Sequence[Mapping[str, Any]]) -> float:
    """All visits over what they would be, had all nodes been as busy as the busiest in each round of each frame."""
    might = sum(frame["cell_visits"] / frame["efficiency_of_rounds"] for frame in frames if frame["efficiency_of_rounds"])
    return sum(frame["cell_visits"] for frame in frames if frame["efficiency_of_rounds"]) / might if might else 1.0


def _tail(frames: Sequence[Mapping[str, Any]]) -> dict[str, float] | None:
    """Each frame has one of its own; None where that of one is not known."""
    tails = [frame["tail"] for frame in frames]
    return None if None in tails else _added(tails)


def _added(rows: Iterable[Mapping[str, float]]) -> dict[str, float]:
    total: dict[str, float] = {}
    for row in rows:
        for name, value in row.items():
            total[name] = round(total.get(name, 0.0) + value, 3)
    return total


def _rounded(value: float) -> float:
    """Seconds that were rounded each, without what adding them brings in; counts as they are."""
    return value if isinstance(value, int) else round(value, 3)
