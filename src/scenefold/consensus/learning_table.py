"""How a node learns what is decided elsewhere (specs/25-consensus.md, Learning). Guards and actions: learning.py."""

from __future__ import annotations

from scenefold.consensus.tables import Row

LEARN = "6"
LOG_ASKED = "5"

LEARNING = (
    Row((LEARN, LOG_ASKED), ("of_another_log",)),
    Row((LEARN,), ("decided_already",)),
    Row((LEARN,), ("cannot_write",)),
    Row((LEARN,), ("too_far_ahead",), ("ask_log",)),
    Row((LEARN,), ("without_its_body",), ("ask_log",)),
    Row((LEARN,), ("unproven",)),
    Row((LEARN,), (), ("decide",)),
    Row((LOG_ASKED,), ("knows_no_more",)),
    Row((LOG_ASKED,), (), ("tell_log",)),
)
