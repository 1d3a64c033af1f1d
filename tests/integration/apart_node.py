"""`python -m integration.apart_node`: a node in the network namespace that belongs to its address (cut_networks.py)."""

from __future__ import annotations

import os
import sys

from integration.cut_networks import VARIABLE, within

if __name__ == "__main__":
    address = sys.argv[sys.argv.index("--address") + 1]
    command = within(os.environ[VARIABLE], address, [sys.executable, "-m", "scenefold.node", *sys.argv[1:]])
    os.execvp(command[0], command)
