"""Log lines about misbehaving peers, bounded, so that nobody can flood the log.

At most one line a minute for each source and kind, and at most LINES_MAX a minute in all: whoever sends datagrams can
write any source on them, a new one each time.
"""

from __future__ import annotations

import logging
from collections import OrderedDict

SILENCE_S = 60.0
LINES_MAX = 30
"""Lines in SILENCE_S seconds, all sources together."""
SOURCES_MAX = 1_024
"""Sources remembered; the longest silent one is forgotten first."""

BUGS = logging.getLogger("scenefold.bugs")
"""What went wrong by our own fault while others were served, with tracebacks. Whoever hunts bugs listens here."""


class QuietLog:
    """Counts what it does not say, and says the count the next time."""

    def __init__(self, log: logging.Logger, level: int = logging.WARNING) -> None:
        self._log = log
        self._level = level
        self._said: OrderedDict[tuple[str, str], tuple[float | None, int]] = OrderedDict()
        self._minute_began: float | None = None
        self._lines = 0
        self._left_out = 0

    def say(self, now: float, source: str, kind: str, text: str, bug: Exception | None = None) -> bool:
        """Log "source: text" unless that is too much by the two bounds. True if it was logged. `bug`: of ours, told with its traceback."""
        self._begin_minute(now)
        said_at, skipped = self._said.pop((source, kind), (None, 0))
        if said_at is not None and now - said_at < SILENCE_S:
            self._remember(source, kind, said_at, skipped + 1)
            return False
        if self._lines >= LINES_MAX:
            self._left_out += 1
            self._remember(source, kind, said_at, skipped + 1)
            return False
        self._lines += 1
        self._remember(source, kind, now, 0)
        more = f" (and {skipped} times more since the last line)" if skipped else ""
        if bug is None:
            self._log.log(self._level, "%s: %s%s", source, text, more)
        else:
            BUGS.error("%s: %s%s", source, text, more, exc_info=bug)
        return True

    def _begin_minute(self, now: float) -> None:
        if self._minute_began is not None and now - self._minute_began < SILENCE_S:
            return
        if self._left_out:
            self._log.log(self._level, "%d complaints like these, of many sources, were left out", self._left_out)
        self._minute_began, self._lines, self._left_out = now, 0, 0

    def _remember(self, source: str, kind: str, said_at: float | None, skipped: int) -> None:
        """`said_at` None: it was never said, only left out."""
        self._said[source, kind] = (said_at, skipped)
        if len(self._said) > SOURCES_MAX:
            self._said.popitem(last=False)
