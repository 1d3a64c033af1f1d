"""How long to wait for an acknowledgement: the estimate of RFC 6298. Pure; seconds."""

from __future__ import annotations

RTO_S_MIN = 1.0
RTO_S_MAX = 8.0
UNKNOWN = 3
"""So many times the least, before anything was measured."""
UNMEASURED_MAX = 4
"""Packets in a row that were acknowledged after they were sent again: from then on the RTO is too short for the link, most likely."""
_SRTT_GAIN = 1 / 8
_RTTVAR_GAIN = 1 / 4


class RoundTrip:
    """Of one link."""

    def __init__(self) -> None:
        self.srtt_s: float | None = None
        """The smoothed round trip, once one was measured."""
        self._rttvar_s = 0.0
        self._doublings = 0
        self._unmeasured = 0

    def measured(self, seconds: float) -> None:
        """A packet that was sent once was acknowledged so long after."""
        self._doublings = self._unmeasured = 0
        if self.srtt_s is None:
            self.srtt_s, self._rttvar_s = seconds, seconds / 2
            return
        self._rttvar_s += _RTTVAR_GAIN * (abs(self.srtt_s - seconds) - self._rttvar_s)
        self.srtt_s += _SRTT_GAIN * (seconds - self.srtt_s)

    @property
    def timeout_s(self) -> float:
        """The RTO, doubled as often as it ran out."""
        measured = UNKNOWN * RTO_S_MIN
        if self.srtt_s is not None:
            # Where all take alike, the next one, which is a little larger, must not be sent again.
            measured = max(RTO_S_MIN, self.srtt_s + max(4 * self._rttvar_s, self.srtt_s / 2))
        return min(RTO_S_MAX, measured * 2.0**self._doublings)

    def ran_out(self) -> None:
        """Nothing came in time."""
        # Once it is the longest, further doublings would only grow the number.
        self._doublings += self.timeout_s < RTO_S_MAX

    def went_on(self) -> None:
        """A packet was acknowledged that was sent again: nobody knows which sending that was. The RTO is as measured again; where none was, or none
        lately, it stays as long as it has become, or no packet would ever be acknowledged before it is sent again."""
        self._unmeasured += 1
        if self.srtt_s is not None and self._unmeasured <= UNMEASURED_MAX:
            self._doublings = 0
