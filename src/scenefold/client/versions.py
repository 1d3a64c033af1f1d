"""The order of a writer's records: each gets a higher number than all that it wrote or read before (storage.md, *Data packets*).

Versions are ordered by (epoch, seq, writer, session, digest). Seq is a hybrid of the wall clock in microseconds
and a counter: it rises within a session whatever the clock does, and a later session of the same user begins
above an earlier one as long as the clock is right by more than the pause between them. Where it is not, the
owner says that the version is stale, and the writer goes on above what is stored (`saw`).
"""

from __future__ import annotations

SEQ_MAX = 2**64 - 1


class Sequencer:
    """Numbers for the records of one session."""

    def __init__(self) -> None:
        self._last = 0

    def next(self, wall_s: float) -> int:
        """A number above all before; `wall_s` is the time of day in seconds since 1970."""
        self._last = max(self._last + 1, int(wall_s * 1e6))
        assert self._last <= SEQ_MAX
        return self._last

    def saw(self, seq: int) -> None:
        """Somebody's record has this number; the next of ours will be above it."""
        self._last = max(self._last, min(seq, SEQ_MAX - 2**32))
