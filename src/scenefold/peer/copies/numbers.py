"""Numbers of configurations: they rise at each place, whoever owns it (specs/20-copies.md, Custody, Recovery). Pure.

Who recovers a gap begins above all that anybody can have said before, at a number that the cluster's log gives.
"""

from __future__ import annotations

_SHIFT = 32


def first_number(position: int) -> int:
    """Where the numbers begin of who recovers a gap that it adopted at this position of the cluster's log."""
    return position << _SHIFT


def is_possible(number: int, position: int) -> bool:
    """Whether an honest owner can have come so far. `position`: how far this node knows the log, which has to ask the owner for it first.

    Who adopts after it begins at its own position: under a higher number than that nobody would tell it what is held there.
    """
    return number >> _SHIFT <= position


def is_believed(number: int, position: int) -> bool:
    """Whether an owner goes on above a number that one holder says it has met.

    Half of what is left until the log goes on stays for its own changes: no honest owner uses up the other half. Else one who lies would bring
    an owner to a number that nobody may take from it.
    """
    return number < first_number(position) + (1 << (_SHIFT - 1))
