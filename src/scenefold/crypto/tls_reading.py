"""A TLS connection's decrypted bytes, as many at once as have arrived.

A record of TLS holds 16 KiB at most, and a reader gets one at a time; a task that waits, wakes and looks at the clock for each spends
more on that than on decrypting it. So all records that are here already are read together, into a place that every reading uses: memory
that is new for each costs more than the copy out of it.
"""

from __future__ import annotations

import ssl
import threading
from typing import Any

LUMP_BYTES_MAX = 256 * 1024
"""Read at once."""


class _Place(threading.local):
    """Each thread has its own."""

    def __init__(self) -> None:
        self.view = memoryview(bytearray(LUMP_BYTES_MAX))


_place = _Place()


class LumpedReading(ssl.SSLObject):
    """Made by a context whose `sslobject_class` it is. What `ssl` does, but for `read` without a buffer."""

    _late: ssl.SSLError | None = None
    """What ended the reading behind what was given."""

    def read(self, count_max: int = 1024, buffer: Any = None) -> Any:
        """Up to so many bytes of all that has arrived. Raises as `ssl` does if that is none."""
        if buffer is not None:
            return super().read(count_max, buffer)
        if self._late is not None:
            raise self._late
        place, most = _place.view, min(count_max, LUMP_BYTES_MAX)
        read: Any = super().read
        count: int = read(most, place)
        try:
            while 0 < count < most and (more := read(most - count, place[count:])):
                count += more
        except ssl.SSLError as error:
            # What came before it is sound, and is given first. That more is to come is no error.
            self._late = None if isinstance(error, ssl.SSLWantReadError) else error
        return bytes(place[:count])
