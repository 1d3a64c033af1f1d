"""Signals that come while a program is still importing what it is made of: it leaves at once, with the words and the exit code that it has later.

Nothing has been begun then that would have to be ended. Python's own way, a KeyboardInterrupt at some line of an import, ends in a
traceback, or is swallowed there. To be called before anything large is imported; whoever begins real work takes the signals over.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Sequence
from types import FrameType


def leave_at(numbers: Sequence[signal.Signals], exit_code: int, *, words: bytes = b"", result: bytes = b"") -> None:
    """From now on the process ends at these signals; `words` go to standard error, `result` to standard output. Ignored ones stay so."""

    def leave(_number: int, _frame: FrameType | None) -> None:
        for stream, text in ((2, words), (1, result)):
            try:
                os.write(stream, text)
            except OSError:
                continue  # nobody listens there, and that is no reason to stay
        os._exit(exit_code)

    for number in numbers:
        # As under nohup, or in the background of a script.
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, leave)
