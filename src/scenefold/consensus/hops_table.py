"""What a node does with what comes back from a proposal of somebody else (specs/25-consensus.md, On the way home). Guards and actions: hops.py."""

from __future__ import annotations

from scenefold.consensus.tables import Row

HOME = "8 or 9"
HOP_OVER = "hop over"

HOPS = (
    Row((HOME,), ("of_another_log",)),
    Row((HOME,), ("shows_a_decision",), ("decide", "pass_home")),
    Row((HOME,), ("my_own",)),
    Row((HOME,), ("brought_by_a_stranger",)),
    Row((HOME,), (), ("pass_home",)),
    Row((HOP_OVER,), ("has_come_back",)),
    Row((HOP_OVER,), (), ("turn_round",)),
)
