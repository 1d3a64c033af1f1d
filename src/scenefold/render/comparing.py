"""Reports of renders, side by side: what each has cost, and what of that its partition explains (docs/reference/scenectl.md). Pure.

A report may be of an earlier version, or of a partition of another kind: what it does not say is None.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, TypeVar

from scenefold.base.errors import LocalFault
from scenefold.base.plain_values import number, text, whole

_COUNT_MAX = 2**64 - 1
T = TypeVar("T", int, float)


@dataclass(frozen=True, slots=True, kw_only=True)
class Compared:
    """One render."""

    report: str
    """Where its report comes from."""
    partition: str
    """spatial, visual or temporal; out-of-core: spatial, in one process (specs/27-out-of-core.md)."""
    scene: str | None
    nodes: int
    """Processes that rendered."""
    seconds: float
    """From the question to the image, without writing it."""
    processor_seconds: float | None
    """Of all nodes together."""
    memory_most: int | None
    """The most bytes that any one node has had."""
    bytes_read: int | None
    """Of the scene's geometry and textures, by all nodes, from store or file."""
    bytes_passed: int
    """Of rays, between nodes."""
    bytes_returned: int | None
    """Of what tasks have made."""
    paths: int
    transfers_per_path: float
    """How often a path's rays were passed on;"""
    bytes_per_path: float
    """and in so many bytes."""
    efficiency: float
    """Work of all over that of the busiest node, or thread, times their number."""
    efficiency_of_rounds: float | None
    """The same, round by round."""
    rounds: int | None
    cells_moved: int | None
    seconds_to_95: float | None
    """Of tracing, until 95 of 100 passes were closed;"""
    seconds_to_100: float | None
    """and until all were."""
    tail: float | None
    """The second over the first."""
    image_sha256: str | None
    """None: there are several images."""

    def document(self) -> dict[str, Any]:
        """The JSON form."""
        return asdict(self)


def compared(document: object, source: str) -> Compared:
    """What counts of a report; LocalFault if it is none. `source`: a file's name, or a render's."""
    try:
        return _compared(_mapping(document), source)
    except (TypeError, ValueError) as error:
        what = f"that is no report of a render: {error!s:.120}"
        remedy = "give what `scenectl render still --report FILE` or `--json` has written"
        raise LocalFault(what, where=source, remedy=remedy) from error


def _compared(document: Mapping[str, Any], source: str) -> Compared:
    rows = _said(document, "render_nodes", _rows)
    alone = None if rows else _if_said(document, "memory", _mapping)
    paths, passed = _said(document, "paths", lambda value: whole(value, 1, _COUNT_MAX)), _said(document, "bytes_passed", _count)
    # What came with a kept render was traced, and passed on, by another one.
    before = _if_said(document, "paths_before", lambda value: whole(value, 0, paths)) or 0
    traced, rays_passed = max(paths - before, 1), _said(document, "rays_passed_per_path", _seconds)
    if "rays_passed" in document:
        rays_passed = _said(document, "rays_passed", _count) / traced
    tail = _if_said(document, "tail", _mapping)
    early, late = (None, None) if tail is None else (_said(tail, "seconds_to_95", _seconds), _said(tail, "seconds_to_100", _seconds))
    processor: float | None = (
        _said(_said(document, "processor_seconds", _mapping), "render", _seconds)
        if alone
        else _all_of(rows, "processor_seconds", _used_s, _sum_s)
    )
    return Compared(
        report=source,
        partition="out-of-core" if alone else _if_said(document, "partition", text) or "spatial",
        scene=_if_said(document, "scene", text),
        nodes=max(len(rows), 1),
        seconds=_said(document, "render_seconds", lambda value: sum(map(_seconds, _mapping(value).values()))),
        processor_seconds=processor,
        memory_most=_all_of([alone] if alone else rows, "memory_most", _used, max),
        bytes_read=None if alone else _all_of(rows, "bytes_read", _count, sum),
        bytes_passed=passed,
        bytes_returned=_if_said(document, "bytes_returned", _count),
        paths=paths,
        transfers_per_path=rays_passed,
        bytes_per_path=passed / traced,
        efficiency=_said(document, "efficiency", _seconds),
        efficiency_of_rounds=_if_said(document, "efficiency_of_rounds", _seconds),
        rounds=_if_said(document, "rounds", len),
        cells_moved=_if_said(document, "cells_moved", _count),
        seconds_to_95=early,
        seconds_to_100=late,
        tail=late / early if early and late is not None else None,
        image_sha256=_if_said(document, "image_sha256", text),
    )


def _all_of(rows: Sequence[Mapping[str, Any]], name: str, kind: Callable[[object], T | None], together: Callable[[list[T]], T]) -> T | None:
    """Of all nodes; None if one does not say it."""
    values = [_if_said(row, name, kind) for row in rows]
    known = [value for value in values if value is not None]
    return together(known) if known and len(known) == len(values) else None


def _said(document: Mapping[str, Any], name: str, kind: Callable[[Any], Any]) -> Any:
    """A value by its key; ValueError that names the key if there is none, or it is of another kind."""
    if name not in document:
        raise ValueError(f"it has no {name!r}")
    try:
        return kind(document[name])
    except (TypeError, ValueError):
        raise ValueError(f"its {name!r} cannot be {document[name]!r:.40}") from None


def _if_said(document: Mapping[str, Any], name: str, kind: Callable[[Any], Any]) -> Any:
    return None if document.get(name) is None else _said(document, name, kind)


def _mapping(value: object) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise TypeError("it is no object")
    return value


def _rows(value: object) -> Sequence[Mapping[str, Any]]:
    if not isinstance(value, list | tuple):
        raise TypeError("it is no list")
    return [_mapping(row) for row in value]


def _count(value: object) -> int:
    return whole(value, 0, _COUNT_MAX)


def _used(value: object) -> int | None:
    """Of what no process takes nothing of: 0 stands where a node of an earlier version says nothing."""
    return _count(value) or None


def _used_s(value: object) -> float | None:
    return _seconds(value) or None


def _sum_s(values: list[float]) -> float:
    return sum(values)


def _seconds(value: object) -> float:
    known = number(value)
    if known < 0:
        raise ValueError("a number from 0 on is expected")
    return known
