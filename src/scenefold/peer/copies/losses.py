"""What may have been lost with nodes that were removed, by what all others hold of a gap (specs/20-copies.md, What is lost). Pure.

Everything that lies on a registered node's disk is found by recovery, so nothing is lost but what lay on removed nodes alone. Whether that
can be, the configurations tell: of the last one that counted there as many members must be gone as a write needed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from scenefold.base.location import LINE_LENGTH, Arc
from scenefold.base.placement import Layout
from scenefold.peer.copies.entries import Entry, alike, clipped
from scenefold.wire import Member
from scenefold.wire.loss_packets import LOSS_ARCS_MAX, LOSS_NODES_MAX

LOSSES_MIN = 2
"""Nodes. Who lets one disk be enough for a write is promised nothing if one is lost; that is said only if no complete copy is left."""


@dataclass(frozen=True, slots=True)
class Loss:
    """In these arcs, of spaces with so many copies. `is_left`: a complete copy is left, so only what was acknowledged last may be missing."""

    copies: int
    is_left: bool
    removed: tuple[Member, ...]
    """On whose disks it lay, as far as that is known; else who was removed."""
    arcs: tuple[Arc, ...]

    @property
    def share(self) -> float:
        """Of the line."""
        return sum(arc.length for arc in self.arcs) / LINE_LENGTH


def losses_in(
    me: Member,
    gap: Arc,
    layouts: Mapping[Layout, int],
    heard: Mapping[Member, Sequence[Entry]],
    is_lost: Callable[[Member], bool],
    lost: Sequence[Member],
    *,
    remembers: bool = True,
) -> list[Loss]:
    """What may be lost of a gap once all were heard. `layouts`: of the known scenes, and what each asks of a write.

    `heard`: by everybody who is registered, the asker `me` included. `lost`: whoever was removed with what it had, the newest last.
    `remembers`: whether the asker knows what it held there itself; else it may hold whatever it is a member of.
    """
    met = {member: clipped(entries, gap) for member, entries in heard.items()}
    told = {entry.layout for entries in met.values() for entry in entries}
    found: dict[tuple[int, bool, tuple[Member, ...]], list[Arc]] = {}
    for layout in sorted({*layouts, *told} - {()}):
        here = {member: [entry for entry in entries if entry.layout == layout] for member, entries in met.items()}
        for arc, stretch in alike(here, gap):
            verdict = _verdict(None if remembers else me, stretch, layouts.get(layout), is_lost, lost)
            if verdict is not None:
                found.setdefault((1 + len(layout), *verdict), []).append(arc)
    return [Loss(*about, arcs=_few(arcs)) for about, arcs in found.items()]


def _verdict(
    unsure: Member | None,
    stretch: Mapping[Member, Entry],
    needed: int | None,
    is_lost: Callable[[Member], bool],
    lost: Sequence[Member],
) -> tuple[bool, tuple[Member, ...]] | None:
    """Whether a complete copy is left, and who is gone; None if nothing can be lost. `unsure`: who may hold what it does not tell."""
    newest = max((entry for entry in stretch.values() if entry.whole), key=lambda entry: entry.number, default=None)
    if newest is not None:
        # What was being filled beside or behind it may have counted as well.
        for entry in (newest, *(entry for entry in stretch.values() if entry.number > newest.number)):
            gone = [member for member in entry.members if is_lost(member)]
            if len(gone) >= max(LOSSES_MIN, entry.needed):
                return True, _newest(gone, lost)
        bound = [member for member in newest.members[1:] if member == unsure or _is_bound(stretch.get(member), newest)]
        if len(bound) > len(newest.members) - max(LOSSES_MIN, newest.needed):
            return None
        # So few hold it still that it may have been closed: there may have been a later configuration, of which nobody has heard.
    if needed is None and not stretch:
        return None
    if len(lost) < max(LOSSES_MIN, needed or LOSSES_MIN):
        # So few cannot have been all that had anything.
        return None
    return newest is not None, tuple(lost[-LOSS_NODES_MAX:])


def _is_bound(told: Entry | None, entry: Entry) -> bool:
    """Whether a member has confirmed nothing that is newer than a configuration: as long as enough are so, it binds all writes."""
    return told is not None and told.number <= entry.number


def _newest(gone: Sequence[Member], lost: Sequence[Member]) -> tuple[Member, ...]:
    return tuple(member for member in lost if member in gone)


def _few(arcs: Sequence[Arc]) -> tuple[Arc, ...]:
    """As many as a loss names. Of more the last ones are one, with all that lies between them: too much rather than too little."""
    joined: list[Arc] = []
    for arc in sorted(arcs, key=lambda arc: arc.first):
        if (joined and joined[-1].last.next() in (None, arc.first)) or (joined and arc.first in joined[-1]):
            joined[-1] = Arc(joined[-1].first, max(arc.last, joined[-1].last))
        else:
            joined.append(arc)
    first, rest = joined[: LOSS_ARCS_MAX - 1], joined[LOSS_ARCS_MAX - 1 :]
    return (*first, Arc(rest[0].first, rest[-1].last)) if rest else tuple(first)
