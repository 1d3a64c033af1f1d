"""Whether this node rests from a duty, by an administrator's order; whoever does it looks here (specs/21-verify.md, Upkeep)."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class Resting:
    """Set by upkeep.py alone. `repair`: holders that more than needed are complete without get nothing for now. `balance`: nothing is given to neighbours."""

    repair: bool = False
    balance: bool = False
