"""Which faults a scene's participants are spared, and who they may be (specs/17-simulation.md, Logs). Pure.

A log whose majority has lost its disks is at its end: nothing of that is to be tested here (specs/25-consensus.md, What holds). Everything
else stays in the schedule as it was drawn.
"""

from __future__ import annotations

import random

from scenefold.simulation.faults import VOTER, Fault, Kind, Schedule

COUNTS = (3, 5, 7)
"""How many participants a scene begins with, seed by seed."""
_LOSES_DISK = frozenset({Kind.WIPED_DISK, Kind.CORRUPTION, Kind.DRAIN, Kind.RESTORED_BACKUP})
"""A node may come back with an empty disk, or not at all, or begins anew since it is found out. What rots beside records may make it begin
anew, too, but for the voter."""


def deciders_of(seed: int) -> int:
    """How many participants the scene of a seed begins with."""
    return COUNTS[seed % len(COUNTS)]


def spared(schedule: Schedule, deciders: int) -> Schedule:
    """The schedule without what would leave no majority. No disk is put back twice: the second time it may be an older one of before the first."""
    left, lost, put_back = list[Fault](), set[int](), set[int]()
    for fault in schedule:
        if fault.kind is Kind.RESTORED_BACKUP and put_back & set(fault.slots):
            continue
        loses = {slot for slot in fault.slots if fault.kind in _LOSES_DISK and (fault.kind is not Kind.CORRUPTION or slot != VOTER)}
        if len(lost | loses) <= max(0, deciders - 1) // 2 or deciders == 0:
            lost |= loses
            left.append(fault)
            put_back |= set(fault.slots) if fault.kind is Kind.RESTORED_BACKUP else set()
    return tuple(left)


def first_deciders(seed: int, nodes: int, deciders: int) -> list[int]:
    """The slots that a seed's scene begins with."""
    return sorted(random.Random(f"participants/{seed}").sample(range(nodes), deciders))
