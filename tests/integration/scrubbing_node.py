"""`python -m integration.scrubbing_node`: a node that begins to read all of its records again a second after its start, and not ten minutes."""

from __future__ import annotations

import sys
from unittest import mock

from scenefold.node.program import main
from scenefold.peer.scrub import scrub

if __name__ == "__main__":
    with mock.patch.object(scrub, "START_S", 1.0):
        sys.exit(main())
