"""The order of a writer's records: numbers that rise within a session (specs/04-records.md, Record).

Each is higher than all that the session wrote or read before, those apart that no clock gives: one of these is passed at its own place alone.

Versions are ordered by (epoch, seq, writer, session, digest). Seq is a hybrid of the wall clock in microseconds
and a counter: it rises within a session whatever the clock does, and a later session of the same user begins
above an earlier one as long as the clock is right by more than the pause between them. Where it is not, the
owner says that the version is stale, and the writer goes on above what is stored (`saw`, or `above` for that record alone).

A number of more than a day from now is no clock's that is nearly right. Were all of a session's records to go on above it, one writer who chose the highest could lead every reader there, and nothing that they wrote could be
written over before the scene's log goes on.
"""

from __future__ import annotations

SEQ_MAX = 2**64 - 1
AHEAD_S_MAX = 24 * 3600.0
"""How far clocks of writers may differ without costing each write that meets one of the other a second try."""


class Sequencer:
    """Numbers for the records of one session."""

    def __init__(self) -> None:
        self._last = 0

    def next(self, wall_s: float, above: int = 0) -> int:
        """A number above all before; `wall_s` is the time of day in seconds since 1970. `above`: what this record alone must be above, too;
        if that is the highest that there is, it is given once more."""
        self._last = max(self._last + 1, int(wall_s * 1e6))
        assert self._last <= SEQ_MAX
        return max(self._last, min(above + 1, SEQ_MAX))

    def saw(self, seq: int, wall_s: float) -> None:
        """Somebody's record has this number; the next of ours will be above it, unless it is of a day that is yet to come."""
        if seq <= int((wall_s + AHEAD_S_MAX) * 1e6):
            self._last = max(self._last, seq)
