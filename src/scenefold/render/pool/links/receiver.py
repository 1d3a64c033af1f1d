"""The receiving end of a link: what came already, and when to say so (specs/30-ray-links.md). Pure; time comes in as seconds."""

from __future__ import annotations

from scenefold.base.errors import PeerFault

WINDOW = 256
"""Numbers that a link spans, from the lowest that is missing on."""
UNSAID_PACKETS_MAX = 16
UNSAID_BYTES_MAX = 1024 * 1024
DELAY_S = 0.2
"""Far less than the least time until something is sent again; what leaves meanwhile takes the acknowledgement along."""


class Receiver:
    """Keeps no packet, only which have come: a number, and a bit for each of `WINDOW` after it."""

    def __init__(self) -> None:
        self._all_until = 0
        self._above = 0
        """Bit i: number _all_until + 1 + i has come."""
        self._unsaid_packets = 0
        self._unsaid_bytes = 0
        self.due_at: float | None = None
        """When to acknowledge; None as long as there is nothing new to say."""

    def has(self, number: int) -> bool:
        """Whether a packet came before. PeerFault for a number outside of the window."""
        place = self._place(number)
        return place < 0 or bool(self._above >> place & 1)

    def take(self, number: int, size: int, now: float) -> bool:
        """A packet of `size` bytes has come: whether it is new, and so counts. PeerFault for a number outside of the window."""
        is_new = not self.has(number)
        if is_new:
            self._above |= 1 << self._place(number)
            while self._above & 1:
                self._above >>= 1
                self._all_until += 1
            self._unsaid_packets += 1
            self._unsaid_bytes += size
        at_once = not is_new or self._above or self._unsaid_packets >= UNSAID_PACKETS_MAX or self._unsaid_bytes >= UNSAID_BYTES_MAX
        due_at = now if at_once else now + DELAY_S
        self.due_at = due_at if self.due_at is None else min(self.due_at, due_at)
        return is_new

    def _place(self, number: int) -> int:
        """Behind the lowest number that is missing; below 0 if it is none that is."""
        place = number - self._all_until - 1
        if number < 1 or place >= WINDOW:
            raise PeerFault("a packet's number lies outside of its link's window", where=f"number {number} after {self._all_until}")
        return place

    def acknowledge(self) -> tuple[int, bytes]:
        """What to say now: the number up to which all have come, and the bits of those after it, lowest bit of the first byte first."""
        self.due_at, self._unsaid_packets, self._unsaid_bytes = None, 0, 0
        return self._all_until, self._above.to_bytes((self._above.bit_length() + 7) // 8, "little")
