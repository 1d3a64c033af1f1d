"""`python -m scenefold.node`: one node as a process, for a supervisor; what it does stands in program.py.

Small on purpose, as is the package: a signal ends a node in order also while it is still being imported.
"""

from __future__ import annotations

import gc
import signal
import sys
from collections.abc import Sequence

from scenefold.base.early_signals import leave_at


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node that these arguments describe, by default this process's; the exit code."""
    leave_at([signal.SIGTERM, signal.SIGINT], 0)
    # What is imported stays. To look through it again and again meanwhile would take a tenth of the start.
    gc.disable()
    from scenefold.node.program import main as run

    gc.freeze()
    gc.enable()
    return run(arguments)


if __name__ == "__main__":
    sys.exit(main())
