"""How much goes to a holder in one packet: less over a slow link, or no packet would ever be answered in time. Pure."""

from __future__ import annotations

BATCH_BYTES_MAX = 2 * 1024 * 1024
BATCH_BYTES_MIN = 32 * 1024
FEWER = 4
"""After an answer that did not come in time so many times less is sent; after one that did, twice as much."""


class BatchSize:
    def __init__(self) -> None:
        self.bytes = BATCH_BYTES_MAX

    def answered(self, *, in_time: bool) -> None:
        self.bytes = min(BATCH_BYTES_MAX, 2 * self.bytes) if in_time else max(BATCH_BYTES_MIN, self.bytes // FEWER)
