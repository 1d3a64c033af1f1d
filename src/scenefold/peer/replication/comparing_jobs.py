"""Whom to compare with what, and what first (specs/20-copies.md, Repair). Pure."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import NamedTuple

from scenefold.base.limits import COMPARED_ARCS_MAX
from scenefold.base.location import Arc
from scenefold.base.placement import Layout
from scenefold.peer.copies.configurations import Configurations
from scenefold.peer.copies.entries import Entry
from scenefold.peer.replication.placing_wishes import target_of
from scenefold.wire import Member


class Job(NamedTuple):
    """Compare these entries with their holder, all of one layout. `is_routine`: he counts as complete already.

    `can_rest`: as many as a write needs are complete without him.
    """

    holder: Member
    layout: Layout
    entries: tuple[Entry, ...]
    is_routine: bool
    can_rest: bool


class _Task(NamedTuple):
    """In the order in which they are done, but for what of."""

    is_put_off: bool
    is_routine: bool
    sound: int
    """How many complete copies there are beside the owner's."""
    can_rest: bool
    entry: Entry


def jobs(
    found: Configurations, is_checked: Callable[[Member, Layout, Arc], bool], put_off: Collection[Entry] = (), *, is_resting: bool = False
) -> dict[Member, Job]:
    """For each holder what is to be done first: where it is not complete, where there are the fewest complete copies.

    `put_off`: what comes behind all else. `is_resting`: only what cannot rest.
    """
    tasks: dict[Member, list[_Task]] = {}
    for segment in found.segments:
        target = target_of(segment, found.me)
        for holder in () if target is None else target[0]:
            entry = segment.wanted(holder, found.me)
            # Before it has confirmed that, it takes nothing, and what is written may miss it.
            if entry is None or segment.bound_of(holder) < entry.number:
                continue
            is_sound = holder in segment.sound
            if not (is_sound and is_checked(holder, segment.layout, segment.arc)):
                assert target is not None
                holders, needed = target
                sound = len(segment.sound.intersection(holders))
                can_rest = 1 + sound >= min(needed, 1 + len(holders))
                if not (is_resting and can_rest):
                    tasks.setdefault(holder, []).append(_Task(entry in put_off, is_sound, sound, can_rest, entry))
    return {holder: _first(holder, listed) for holder, listed in tasks.items()}


def waiting(found: Configurations) -> int:
    """Pairs of a segment and a holder that is not complete."""
    return sum(
        holder not in segment.sound
        for segment in found.segments
        if (target := target_of(segment, found.me)) is not None
        for holder in target[0]
    )


def _first(holder: Member, tasks: list[_Task]) -> Job:
    first = min(tasks, key=lambda task: (task[:4], task.entry.layout, task.entry.arc.first))
    alike = [task.entry for task in tasks if task[:4] == first[:4] and task.entry.layout == first.entry.layout]
    ordered = sorted(alike, key=lambda entry: entry.arc.first)
    return Job(holder, first.entry.layout, tuple(ordered[:COMPARED_ARCS_MAX]), first.is_routine, first.can_rest)
