"""A TLS connection's decrypted bytes, as many at once as have arrived.

A record of TLS holds 16 KiB at most, and a reader gets one at a time; a task that waits, wakes and looks at the clock for each spends
more on that than on decrypting it. So all records that are here already are read together.
"""

from __future__ import annotations

import ssl
from typing import Any


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
        data: bytes = super().read(count_max)
        if not data:
            return data
        pieces, left = [data], count_max - len(data)
        try:
            while left and (more := super().read(left)):
                pieces.append(more)
                left -= len(more)
        except ssl.SSLError as error:
            # What came before it is sound, and is given first. That more is to come is no error.
            self._late = None if isinstance(error, ssl.SSLWantReadError) else error
        return data if len(pieces) == 1 else b"".join(pieces)
