"""Numbers of configurations: they rise at each place, whoever owns it (specs/20-copies.md, Custody, Recovery). Pure.

Who recovers a gap begins above all that anybody can have said before, at a number that the cluster's log gives.
"""

from __future__ import annotations

_SHIFT = 32
_AHEAD_MAX = 1 << 16
"""Positions of the log that this node may not know yet."""


def first_number(position: int) -> int:
    """Where the numbers begin of who recovers a gap that it adopted at this position of the cluster's log."""
    return position << _SHIFT


def is_possible(number: int, position: int) -> bool:
    """Whether an honest owner can have come so far. `position`: how far this node knows the log.

    Numbers end, so who said the last one would leave none to any owner after it.
    """
    return number >> _SHIFT <= position + _AHEAD_MAX
