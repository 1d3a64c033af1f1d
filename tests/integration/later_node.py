"""`python -m integration.later_node`: a node, of the next version of the protocol if LATER_NODES names its address; else as it is."""

from __future__ import annotations

import os
import sys
from unittest import mock

from following_version import BOTH, next_version
from scenefold.node.program import main
from scenefold.world import versions

if __name__ == "__main__":
    address = sys.argv[sys.argv.index("--address") + 1]
    if address in os.environ["LATER_NODES"].split(","):
        with next_version(), mock.patch.object(versions, "TAKEN", BOTH):
            sys.exit(main())
    sys.exit(main())
