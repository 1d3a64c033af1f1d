"""What this process has used of its computer so far, as its reports say it."""

from __future__ import annotations

import resource
import sys
import time
from typing import NamedTuple

_UNIT = 1 if sys.platform == "darwin" else 1024
"""Of the system's figure."""


class ProcessUse(NamedTuple):
    """Since the process began."""

    processor_s: float
    """Of all of its threads, in the kernel, too."""
    memory_most: int
    """The most bytes of memory that it had at any time, mapped files that were read included."""


def process_use() -> ProcessUse:
    """Of this process, without those that it started."""
    return ProcessUse(time.process_time(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * _UNIT)
