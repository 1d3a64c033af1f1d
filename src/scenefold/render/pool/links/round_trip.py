"""How long to wait for an acknowledgement: the estimate of RFC 6298. Pure; seconds."""

from __future__ import annotations

RTO_S_MIN = 1.0
RTO_S_MAX = 8.0
_SRTT_GAIN = 1 / 8
_RTTVAR_GAIN = 1 / 4


class RoundTrip:
    """Of one link."""

    def __init__(self) -> None:
        self.srtt_s: float | None = None
        """The smoothed round trip, once one was measured."""
        self._rttvar_s = 0.0
        self._doublings = 0

    def measured(self, seconds: float) -> None:
        """A packet that was sent once was acknowledged so long after."""
        if self.srtt_s is None:
            self.srtt_s, self._rttvar_s = seconds, seconds / 2
            return
        self._rttvar_s += _RTTVAR_GAIN * (abs(self.srtt_s - seconds) - self._rttvar_s)
        self.srtt_s += _SRTT_GAIN * (seconds - self.srtt_s)

    @property
    def timeout_s(self) -> float:
        """The RTO, as often doubled as it ran out since something was acknowledged."""
        measured = RTO_S_MIN if self.srtt_s is None else max(RTO_S_MIN, self.srtt_s + 4 * self._rttvar_s)
        return min(RTO_S_MAX, measured * 2.0**self._doublings)

    def ran_out(self) -> None:
        """Nothing came in time."""
        # Once it is the longest, further doublings would only grow the number.
        self._doublings += self.timeout_s < RTO_S_MAX

    def went_on(self) -> None:
        """Something new was acknowledged."""
        self._doublings = 0
