"""Log lines about misbehaving peers, at most one a minute for each source and kind, so that nobody can flood the log."""

from __future__ import annotations

import logging
from collections import OrderedDict

SILENCE_S = 60.0
SOURCES_MAX = 1_024
"""Sources remembered; the longest silent one is forgotten first."""


class QuietLog:
    """Counts what it does not say, and says the count the next time."""

    def __init__(self, log: logging.Logger, level: int = logging.WARNING) -> None:
        self._log = log
        self._level = level
        self._said: OrderedDict[tuple[str, str], tuple[float, int]] = OrderedDict()

    def say(self, now: float, source: str, kind: str, text: str) -> bool:
        """Log "source: text" unless this kind was logged of this source within the last minute. True if it was."""
        said_at, skipped = self._said.pop((source, kind), (now - SILENCE_S, 0))
        if now - said_at < SILENCE_S:
            self._said[source, kind] = (said_at, skipped + 1)
            return False
        self._said[source, kind] = (now, 0)
        if len(self._said) > SOURCES_MAX:
            self._said.popitem(last=False)
        more = f" (and {skipped} times more since the last line)" if skipped else ""
        self._log.log(self._level, "%s: %s%s", source, text, more)
        return True
