"""How space may be divided among nodes, by name, and the rule by which cells move (specs/29-moving-cells.md, Options)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from scenefold.base.errors import LocalFault, UsageFault

if TYPE_CHECKING:
    from scenefold.partition.rules import Rule

RESTING = "voronoi"
"""Cells that no rule moves."""
WHOLE = "whole"
"""No cells: every node holds the whole scene, and gets paths (specs/33-dealt-paths.md)."""
USUAL_ALGORITHM = "bounded-radial"
ALGORITHMS = (
    "vivaldi", "no-certainty", "swarming", "no-backtracking", "voxelised-swarming", "planar", "radial", "bounded-radial", "power", "kd",
    RESTING, WHOLE,
)  # fmt: skip
"""All that are built in."""


def check_algorithm(name: str) -> None:
    """UsageFault if there is none of this name, built in or installed."""
    if name in ALGORITHMS:
        return
    try:
        rule_of(name)
    except LocalFault as fault:
        raise UsageFault(
            f"there is no algorithm {name!r:.40}", where="algorithm", remedy=f"choose one of {', '.join(ALGORITHMS)}"
        ) from fault


def rule_of(name: str) -> Rule | None:
    """By which cells move; None: by none. LocalFault if there is no algorithm of this name."""
    if name in (RESTING, WHOLE):
        return None
    from scenefold.partition.registry import load_algorithm

    return load_algorithm(name).rule
