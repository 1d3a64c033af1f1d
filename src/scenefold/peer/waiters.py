"""Tasks that wait until something holds that whoever changes it cannot know of."""

from __future__ import annotations

from collections.abc import Callable

import trio


class Waiters:
    """Conditions and who waits for them. Used from the Trio thread only."""

    def __init__(self) -> None:
        self._conditions: dict[trio.Event, Callable[[], bool]] = {}

    async def until(self, condition: Callable[[], bool]) -> None:
        """Return once the condition holds, at once if it does now. It is looked at whenever there are news."""
        while not condition():
            news = trio.Event()
            self._conditions[news] = condition
            try:
                await news.wait()
            finally:
                self._conditions.pop(news, None)

    def tell(self) -> None:
        """There are news: wake those whose condition holds. Most news are what nobody waits for."""
        for news, condition in list(self._conditions.items()):
            if condition():
                news.set()
                del self._conditions[news]
