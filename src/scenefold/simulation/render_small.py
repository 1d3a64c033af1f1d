"""What a pass, a frame and a film's part are, 128 times smaller in runs that render, and a link's credit, 2,048 times (specs/17-simulation.md, Renders).

So an image of some hundred pixels has dozens of passes, its rays travel in many frames, a broken link soon has no credit left, and films travel in
parts. All else of a render, times above all, is as people have it.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from contextlib import contextmanager

SMALLER, CREDIT_SMALLER = 128, 2048
"""Few rays of so small a pass go over one link: its credit is to run out all the same."""
_BOUNDS = (
    ("scenefold.render.passes", "PASS_PATHS_MAX", SMALLER),
    ("scenefold.render.film", "PART_BYTES", SMALLER),
    ("scenefold.render.pool.member", "QUEUE_RAYS_ENOUGH", SMALLER),
    ("scenefold.render.pool.work", "TAKE_RAYS_MAX", SMALLER),
    ("scenefold.render.pool.outbox", "FRAME_RAYS_MAX", SMALLER),
    ("scenefold.render.pool.outbox", "FRAME_RAYS_ENOUGH", SMALLER),
    ("scenefold.render.pool.links.sender", "BYTES_MAX", CREDIT_SMALLER),
    ("scenefold.render.pool.links.receiver", "UNSAID_BYTES_MAX", SMALLER),
    ("scenefold.render.pool.service", "IMAGE_PART_BYTES", SMALLER),
)


@contextmanager
def small_passes(*, wanted: bool) -> Iterator[None]:
    """Within this context, in this process, if that is wanted."""
    changed = [(importlib.import_module(module), name, by) for module, name, by in _BOUNDS] if wanted else []
    before = [getattr(module, name) for module, name, _ in changed]
    for (module, name, by), bound in zip(changed, before, strict=True):
        assert bound % by == 0, f"{name} is no multiple of {by}"
        setattr(module, name, bound // by)
    try:
        yield
    finally:
        for (module, name, _), bound in zip(changed, before, strict=True):
            setattr(module, name, bound)
