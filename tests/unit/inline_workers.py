"""Work for threads, run inline: a clock that jumps as soon as all tasks wait must not jump while a thread is at work."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import trio


class InlineWorkers:
    """The port `Workers` without threads. A call is atomic; other tasks have their turn before it."""

    async def run(self, _lane: str, function: Callable[..., Any], *args: object) -> Any:
        await trio.lowlevel.checkpoint()
        return function(*args)
