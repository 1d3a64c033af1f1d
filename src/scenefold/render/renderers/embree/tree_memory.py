"""How much memory Embree's trees take, to the byte, and no more than they may: Embree asks before it takes any.

Embree 4's rtcSetDeviceMemoryMonitorFunction: called with the bytes that will be taken, or were given back (negative), and whether that has
happened already; false refuses, unless it has.
"""

from __future__ import annotations

import ctypes
import threading

MONITOR = ctypes.CFUNCTYPE(ctypes.c_bool, ctypes.c_void_p, ctypes.c_ssize_t, ctypes.c_bool)


class TreeMemory:
    """Of all trees of one render. Thread safe."""

    def __init__(self, limit: int) -> None:
        self.limit = limit
        """Bytes."""
        self.held = 0
        """Bytes that Embree has now."""
        self.most = 0
        """The most that it had."""
        self._lock = threading.Lock()
        # Embree keeps the address alone, so the function lives as long as this.
        self.monitor = MONITOR(self._changes)

    def _changes(self, _given: object, more: int, has_happened: bool) -> bool:
        with self._lock:
            if more > 0 and not has_happened and self.held + more > self.limit:
                return False
            self.held += more
            self.most = max(self.most, self.held)
            return True
