"""What the tasks of a render have told, added up into its report (docs/reference/scenectl.md, *Report of an image*). Pure."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from scenefold.base.errors import LocalFault
from scenefold.render.tasks.work import Seen, Use


@dataclass(slots=True)
class _Node:
    """A process in which tasks were done."""

    processor_from_s: float
    processor_to_s: float
    tasks: int = 0
    threads: set[int] = field(default_factory=set)
    memory_most: int = 0
    bytes_read: int = 0
    busy_s: float = 0.0
    rays: int = 0
    casts: int = 0
    shadow_casts: int = 0
    not_finite: int = 0
    clamped: int = 0


@dataclass(slots=True)
class Figures:
    """Of one render."""

    paths: int = 0
    bytes_returned: int = 0
    """Of what tasks have made, as it came back."""
    seen: Seen | None = None
    """Of the first task that was done."""
    _nodes: dict[str, _Node] = field(default_factory=dict)
    _casts: dict[tuple[str, int], int] = field(default_factory=dict)
    """By thread."""

    def add(self, seen: Seen, use: Use, returned: int, *, is_same_scene: bool = True) -> None:
        """One task more. LocalFault if it makes no image together with those before.

        `returned`: bytes. `is_same_scene`: all tasks are of one scene; else they are images of their own, and need the class alone.
        """
        first = self.seen = self.seen or seen
        if seen.numeric_class != first.numeric_class:
            what = (
                f"workers render in two numeric classes, {first.numeric_class:.80} and {seen.numeric_class:.80}, whose bits make no image"
            )
            raise LocalFault(what, where=use.node, remedy="have the same versions, and processors of one maker, on all workers")
        if is_same_scene and seen.content != first.content:
            remedy = "see that the same file lies under that path on all of them"
            raise LocalFault("workers have read different scenes", where=use.node, remedy=remedy)
        node = self._nodes.setdefault(use.node, _Node(use.processor_from_s, use.processor_to_s))
        node.processor_from_s = min(node.processor_from_s, use.processor_from_s)
        node.processor_to_s = max(node.processor_to_s, use.processor_to_s)
        node.memory_most = max(node.memory_most, use.memory_most)
        node.tasks += 1
        node.threads.add(use.thread)
        for name in ("bytes_read", "busy_s", "rays", "casts", "shadow_casts", "not_finite", "clamped"):
            setattr(node, name, getattr(node, name) + getattr(use, name))
        thread = use.node, use.thread
        self._casts[thread] = self._casts.get(thread, 0) + use.casts
        self.paths += use.paths
        self.bytes_returned += returned

    def efficiency(self, threads: int) -> float:
        """Mean work of so many threads, also of those that had none, over that of the busiest one."""
        most = max(self._casts.values(), default=0)
        # There are more if a worker came later, or in the place of one that died.
        return sum(self._casts.values()) / (max(threads, len(self._casts)) * most) if most else 1.0

    def document(self, pixels: int, seconds: dict[str, float], threads: int) -> dict[str, Any]:
        """As of an image that a pool has made, as far as it can be said.

        `pixels`: of all images together; `seconds`: of the phases; `threads`: that the engine has.
        """
        assert self.seen is not None, "something was done"
        nodes = self._nodes.values()
        rays, rendering = sum(node.rays for node in nodes), max(seconds.get("render", 0.0), 1e-9)
        return {
            "paths": self.paths,
            "samples_per_pixel": self.paths / pixels,
            "numeric_class": self.seen.numeric_class,
            "paths_before": 0,
            "paths_per_second": self.paths / rendering,
            "rays": rays,
            "rays_per_second": rays / rendering,
            "cell_visits": sum(node.casts for node in nodes),
            "rays_passed": 0,
            "rays_passed_per_path": 0.0,
            "packets_passed": 0,
            "bytes_passed": 0,
            "bytes_returned": self.bytes_returned,
            "efficiency": self.efficiency(threads),
            "contributions_not_finite": sum(node.not_finite for node in nodes),
            "contributions_clamped": sum(node.clamped for node in nodes),
            "render_seconds": {name: round(value, 3) for name, value in seconds.items()},
            "render_nodes": [_row(name, node) for name, node in sorted(self._nodes.items())],
        }


def _row(name: str, node: _Node) -> dict[str, Any]:
    return {
        "address": name,
        "threads": len(node.threads),
        "tasks": node.tasks,
        "bytes_read": node.bytes_read,
        "rays": node.rays,
        "casts": node.casts,
        "shadow_casts": node.shadow_casts,
        "busy_seconds": round(node.busy_s, 3),
        "processor_seconds": round(node.processor_to_s - node.processor_from_s, 3),
        "memory_most": node.memory_most,
        "not_finite": node.not_finite,
        "clamped": node.clamped,
    }
