"""What happened in a simulation, line by line, and a hash over all of it.

Two runs with one seed must give one hash, in any process; so a line holds nothing that depends on the process (no ids
of objects, no addresses in memory, no order of a set). A line is

    <virtual seconds, nine digits> <kind> <detail> <detail> ...

Lines are hashed as they come; the last ones, or all, may be kept for the story of a failing seed.
"""

from __future__ import annotations

import hashlib
from collections import Counter, deque
from collections.abc import Callable
from typing import TextIO

KEPT_LINES = 2_000


class Trace:
    """Hashes lines; keeps the last `keep` of them, and writes each to `file` if there is one."""

    def __init__(self, *, keep: int = KEPT_LINES, file: TextIO | None = None) -> None:
        self._hash = hashlib.sha256()
        self._file = file
        self.last: deque[str] = deque(maxlen=keep)
        self.counts: Counter[str] = Counter()
        """How many lines there were of each kind."""
        self.on_line: Callable[[str], None] | None = None

    @property
    def hash(self) -> str:
        """SHA-256 of everything so far, in hexadecimal."""
        return self._hash.hexdigest()

    @property
    def lines(self) -> int:
        return self.counts.total()

    def write(self, now: float, kind: str, *details: object) -> None:
        """One line. Details are written with `str`, so give none whose text differs from process to process."""
        line = f"{now:.9f} {kind} {' '.join(map(str, details))}\n"
        self._hash.update(line.encode())
        self.last.append(line)
        self.counts[kind] += 1
        if self._file is not None:
            self._file.write(line)
        if self.on_line is not None:
            self.on_line(line)
