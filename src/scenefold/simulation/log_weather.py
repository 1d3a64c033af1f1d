"""Which faults a scene's participants are spared, and who they may be (specs/17-simulation.md, Logs). Pure.

A log whose majority has lost its disks is at its end, and no participant may be put back to an earlier state: nothing of that is to be
tested here (specs/25-consensus.md, What holds). Everything else stays in the schedule as it was drawn.
"""

from __future__ import annotations

import random

from scenefold.simulation.faults import VOTER, Fault, Kind, Schedule

COUNTS = (3, 5, 7)
"""How many participants a scene begins with, seed by seed."""
_LOSES_DISK = frozenset({Kind.WIPED_DISK, Kind.CORRUPTION, Kind.DRAIN})
"""A node may come back with an empty disk, or not at all. What rots beside records may make it begin anew, but for the voter."""


def deciders_of(seed: int) -> int:
    """How many participants the scene of a seed begins with."""
    return COUNTS[seed % len(COUNTS)]


def spared(schedule: Schedule, nodes: int, deciders: int) -> Schedule:
    """The schedule without what would leave no majority, or put a participant back."""
    left, lost = list[Fault](), set[int]()
    for fault in schedule:
        loses = {slot for slot in fault.slots if fault.kind in _LOSES_DISK and (fault.kind is not Kind.CORRUPTION or slot != VOTER)}
        if len(lost | loses) <= max(0, deciders - 1) // 2 or deciders == 0:
            lost |= loses
            left.append(fault)
    put_back = {slot for fault in left if fault.kind is Kind.RESTORED_BACKUP for slot in fault.slots}
    if nodes - len(put_back) < deciders:
        left = [fault for fault in left if fault.kind is not Kind.RESTORED_BACKUP]
    return tuple(left)


def may_decide(schedule: Schedule, nodes: int) -> list[int]:
    """The slots of founders that may be participants."""
    put_back = {slot for fault in schedule if fault.kind is Kind.RESTORED_BACKUP for slot in fault.slots}
    return [slot for slot in range(nodes) if slot not in put_back]


def first_deciders(seed: int, schedule: Schedule, nodes: int, deciders: int) -> list[int]:
    """The slots that a seed's scene begins with."""
    return sorted(random.Random(f"participants/{seed}").sample(may_decide(schedule, nodes), deciders))
