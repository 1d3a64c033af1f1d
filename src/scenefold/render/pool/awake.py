"""Time that passes while this machine is awake, for what is waited for from other nodes.

The world's clock goes on while a machine sleeps, as leases need it. But nothing can come in that time: who slept for a minute has not waited
for one, and nodes on one machine sleep together. Trio's clock stands still then.
"""

from __future__ import annotations

from typing import Protocol

import trio


class Timepiece(Protocol):
    """Seconds since some moment."""

    def now(self) -> float: ...


class Awake:
    """By Trio's clock; only within its run."""

    def now(self) -> float:
        return trio.current_time()
