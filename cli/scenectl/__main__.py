"""`scenectl` as a process: what a signal does before there is anything to stop, then the program itself.

Small on purpose: whatever is imported before `main` runs is a time in which Ctrl-C shows a traceback.
"""

from __future__ import annotations

import gc
import signal
import sys
from collections.abc import Sequence

from scenectl.flags import is_given
from scenefold.base.early_signals import leave_at

INTERRUPTED = 130
WORDS = b"error: interrupted: the same command may be given again\n"
RESULT = (
    b'{"error": {"kind": "interrupted", "what": "interrupted", "where": "", "remedy": "the same command may be given again"}, '
    b'"exit_code": 130}\n'
)
"""What errors.py says of an interruption; tests hold it equal."""
_SERVICES = (["node", "run"], ["node", "local"], ["cluster", "join"])
"""Verbs that go on until they are told to stop: SIGTERM is their usual end."""


def main() -> int:
    """Run the command of this process and return its exit code."""
    _leave_in_words(sys.argv[1:])
    # What is imported stays: the collector of garbage need not look through it meanwhile.
    gc.disable()
    from scenectl.program import main as run

    gc.freeze()
    gc.enable()
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        # From here on a verb may have something to end in order, and `run` says the same words.
        signal.signal(signal.SIGINT, signal.default_int_handler)
    return run()


def _leave_in_words(tokens: Sequence[str]) -> None:
    result = RESULT if is_given("--json", tokens) else b""
    leave_at([signal.SIGINT, signal.SIGTERM, signal.SIGHUP], INTERRUPTED, words=WORDS, result=result)
    if tokens[:2] in _SERVICES:
        leave_at([signal.SIGTERM], 0)


if __name__ == "__main__":
    sys.exit(main())
