"""What a pass, a frame, credit and a film's part are, 128 times smaller in runs that render (specs/17-simulation.md, Renders).

So an image of some hundred pixels has dozens of passes, its rays travel in many frames, a broken link soon has no credit left, and films travel in
parts. All else of a render, times above all, is as people have it.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from contextlib import contextmanager

SMALLER = 128
_BOUNDS = (
    ("scenefold.render.passes", "PASS_PATHS_MAX"),
    ("scenefold.render.film", "PART_BYTES"),
    ("scenefold.render.pool.member", "QUEUE_RAYS_ENOUGH"),
    ("scenefold.render.pool.work", "TAKE_RAYS_MAX"),
    ("scenefold.render.pool.outbox", "FRAME_RAYS_MAX"),
    ("scenefold.render.pool.outbox", "FRAME_RAYS_ENOUGH"),
    ("scenefold.render.pool.links.sender", "BYTES_MAX"),
    ("scenefold.render.pool.links.receiver", "UNSAID_BYTES_MAX"),
    ("scenefold.render.pool.service", "IMAGE_PART_BYTES"),
)


@contextmanager
def small_passes(*, wanted: bool) -> Iterator[None]:
    """Within this context, in this process, if that is wanted."""
    changed = [(importlib.import_module(module), name) for module, name in _BOUNDS] if wanted else []
    before = [getattr(module, name) for module, name in changed]
    for (module, name), bound in zip(changed, before, strict=True):
        assert bound % SMALLER == 0, f"{name} is no multiple of {SMALLER}"
        setattr(module, name, bound // SMALLER)
    try:
        yield
    finally:
        for (module, name), bound in zip(changed, before, strict=True):
            setattr(module, name, bound)
