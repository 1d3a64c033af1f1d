"""The tasks themselves: plain functions of plain values, that whoever schedules them calls in any thread of any process.

To import this takes little, and none of numba: who unpickles a task has not yet said where compiled kernels lie.
"""

from __future__ import annotations

import os
import platform
import threading
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from scenefold.base.kernel_cache import use_kernel_cache
from scenefold.render.job import RenderOptions
from scenefold.render.tasks.holding import Holding
from scenefold.render.tasks.runs import Run
from scenefold.render.tasks.sources import Source
from scenefold.world.process_use import process_use

if TYPE_CHECKING:
    from scenefold.render.developing import Box
    from scenefold.render.layers import Pixels
    from scenefold.render.tasks.whole_scene import WholeScene

_held: Holding[WholeScene] = Holding()
"""By this process. A scheduler hands over functions, so there is nobody else to keep it."""


@dataclass(frozen=True, slots=True)
class Asked:
    """Of which scene, and which image."""

    render: str
    """A name that no other render has."""
    source: Source
    options: RenderOptions
    content: bytes | None = None
    """The digest of the scene's document; None: whatever it is."""


@dataclass(slots=True, kw_only=True)
class Use:
    """What a task has taken, and done, and where."""

    node: str
    """Computer and process."""
    thread: int
    processor_from_s: float
    """Of the process, when the task began,"""
    processor_to_s: float = 0.0
    """and when it ended."""
    memory_most: int = 0
    """Of the process, bytes, so far."""
    busy_s: float = 0.0
    """That the task traced."""
    bytes_read: int = 0
    """Of the scene, for this task and those after it."""
    paths: int = 0
    rays: int = 0
    casts: int = 0
    shadow_casts: int = 0
    not_finite: int = 0
    clamped: int = 0


@dataclass(frozen=True, slots=True)
class Seen:
    """What follows from scene and image alone: equal for all tasks of a render of one scene."""

    numeric_class: str
    content: bytes
    box: Box
    near: float
    not_carried: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class TracedRun:
    """A part of a film."""

    run: Run
    rows: bytes
    """The run's rows, as they are in a film (specs/08-passes.md, *The film*)."""
    seen: Seen
    use: Use


@dataclass(frozen=True, slots=True)
class MadeFrame:
    """An image."""

    layers: dict[str, Pixels]
    seen: Seen
    use: Use


def trace_run(asked: Asked, run: Run, goes_on: bytes) -> TracedRun:
    """Trace some samples of some rows; `goes_on`: a byte for each row, 0 for those that have enough; or none: all go on.

    Who does several of a render reads its scene once. RenderEnded if the render ends meanwhile; the errors of `open_whole`.
    """
    use_kernel_cache()
    from scenefold.render.tasks.tracing import rows_of
    from scenefold.render.tasks.whole_scene import open_whole

    use = _begun()

    def check() -> None:
        _held.check(asked.render)

    with _held.borrowed(asked.render, lambda: open_whole(asked.source, asked.options, check, asked.content)) as (whole, is_new):
        use.bytes_read = whole.bytes_read if is_new else 0
        begun = time.monotonic()
        with whole.tracer() as tracer:
            rows = rows_of(tracer, whole.job, run, goes_on, use, check)
        use.busy_s = time.monotonic() - begun
        return TracedRun(run, rows.words.tobytes(), _seen(whole), _ended(use))


def render_frame(asked: Asked) -> MadeFrame:
    """Make a whole image in this thread. RenderEnded if the render ends meanwhile; the errors of `open_whole`."""
    use_kernel_cache()
    from scenefold.render.developing import develop
    from scenefold.render.tasks.tracing import film_of
    from scenefold.render.tasks.whole_scene import open_whole

    def check() -> None:
        _held.check(asked.render)

    use = _begun()
    whole = open_whole(asked.source, asked.options, check, asked.content)
    try:
        use.bytes_read = whole.bytes_read
        begun = time.monotonic()
        with whole.tracer() as tracer:
            film = film_of(tracer, whole.job, use, check)
        use.busy_s = time.monotonic() - begun
        return MadeFrame(develop(film, whole.job.layers, whole.box, whole.near), _seen(whole), _ended(use))
    finally:
        whole.close()


def end_render(render: str) -> None:
    """No task of this render is wanted any more in this process."""
    _held.end(render)


def _begun() -> Use:
    node = f"{platform.node() or 'localhost'}:{os.getpid()}"
    return Use(node=node, thread=threading.get_ident(), processor_from_s=process_use().processor_s)


def _ended(use: Use) -> Use:
    use.processor_to_s, use.memory_most = process_use()
    return use


def _seen(whole: WholeScene) -> Seen:
    return Seen(whole.job.numeric_class, whole.job.content, whole.box, whole.near, whole.not_carried)
