"""How soon an author tries again (specs/16-scene-log.md, Author)."""

from __future__ import annotations

from scenefold.base.limits import CLIENT_PAUSE_S
from scenefold.client.calls import Calls
from scenefold.client.patience import Patience

LATE_AT_ONCE = 4


class Pace:
    """Of one change. `failures`: tries that came to nothing though nobody was faster."""

    def __init__(self, calls: Calls) -> None:
        self._calls, self._patience = calls, Patience()
        self._tries = self._late = 0
        self.failures = 0

    async def pause(self, *, is_late: bool) -> None:
        """Before each try. `is_late`: a participant has just said that others were faster.

        It keeps a place for us, and has had us wait as long as it takes: whoever pauses loses that.
        """
        self._tries += 1
        if is_late:
            self._late += 1
            if self._late > LATE_AT_ONCE:
                # It may keep none.
                await self._calls.world.clock.sleep(CLIENT_PAUSE_S * self._calls.world.entropy.uniform())
        elif self._tries > 1:
            self.failures += 1
            self._patience.bears(None)
            await self._calls.pause(self._patience)
