"""`python -m integration.rounding_node`: a node that rounds otherwise, as on a processor of another maker, if SCENEFOLD_ROUNDS_OTHERWISE names its address.

Its Embree takes other instructions for reciprocals than it says. Nodes as users run them know nothing of this.
"""

from __future__ import annotations

import os
import sys

from scenefold.node.program import main
from scenefold.render.renderers.embree import library

VARIABLE = "SCENEFOLD_ROUNDS_OTHERWISE"

if __name__ == "__main__":
    if sys.argv[sys.argv.index("--address") + 1] in os.environ[VARIABLE].split(","):
        vars(library)["ISA"] = "sse2"
    sys.exit(main())
