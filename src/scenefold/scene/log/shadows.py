"""Where a space's copies belong, by what the public header says of its shadows (specs/16-scene-log.md, Shadows). Pure.

Nodes have the header alone, and logs of former versions hold shadows by weaker rules. So what counts is decided from the header's
entries, by everybody alike; the stricter rules are for whoever adds to a log (`check_added`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

from scenefold.base.errors import Refused
from scenefold.base.ids import SceneId, SpaceId
from scenefold.base.limits import COPIES_MAX
from scenefold.base.location import FIRST, LINE_LENGTH, Location
from scenefold.base.reasons import RejectReason
from scenefold.scene.log.turns import Turn, shift_of, shifted
from scenefold.wire import SpaceEntry

NO_SCENE = SceneId(0)


@dataclass(frozen=True, slots=True)
class Layouts:
    """What a header says of the copies of a scene's spaces."""

    offsets: Mapping[SpaceId, tuple[Location, ...]]
    """Of each space that is no shadow: how far from a record its copies belong, in the order of the shadows' numbers."""
    needed: Mapping[SpaceId, int]
    """Of the same: how many must hold a record before a write counts as done; never more than there can be."""
    wanted: Mapping[SpaceId, int]
    """Of the same: how many copies there shall be. Only a log of a former version has fewer shadows than that takes."""
    parents: Mapping[SpaceId, SpaceId]
    """Of each shadow: the space whose records it holds."""
    shadows: Mapping[SpaceId, tuple[SpaceId, ...]]
    """Of each space that is no shadow: the shadows that `offsets` are those of."""
    turns: Mapping[SpaceId, Turn]
    """Of each that has had other copies before: since when it has these."""

    @classmethod
    def of(cls, spaces: Iterable[SpaceEntry], scene: SceneId = NO_SCENE) -> Layouts:
        """By the entries of a header. Of two with one number, which no log can give, the first counts.

        `scene`: whose they are, without which the offsets of spaces that turned are not quite those by which nodes go.
        """
        entries: dict[SpaceId, SpaceEntry] = {}
        for entry in spaces:
            entries.setdefault(entry.space, entry)
        parents = [entry for entry in entries.values() if not entry.parent]
        sound = sound_shadows(entries.values())
        used = {entry.space: sound.get(entry.space, ())[: max(1, min(entry.copies, COPIES_MAX)) - 1] for entry in parents}
        shifts = {entry.space: shift_of(scene, entry.space, entry.offset.number) for entry in parents}
        offsets = {space: shifted((shadow.offset for shadow in shadows), shifts[space]) for space, shadows in used.items()}
        return cls(
            offsets=offsets,
            needed={entry.space: max(1, min(entry.copies_min, 1 + len(offsets[entry.space]))) for entry in parents},
            wanted={entry.space: max(1, min(entry.copies, COPIES_MAX)) for entry in parents},
            parents={entry.space: entry.parent for entry in entries.values() if entry.parent},
            shadows={space: tuple(shadow.space for shadow in shadows) for space, shadows in used.items()},
            turns={
                entry.space: Turn(
                    scene, entry.space, entry.offset.number, frozenset(shadow.offset.number for shadow in sound.get(entry.space, ()))
                )
                for entry in parents
                if entry.offset != FIRST
            },
        )

    def lacking(self) -> dict[SpaceId, int]:
        """Spaces with fewer shadows than their copies take, and how many copies those make."""
        return {space: 1 + len(found) for space, found in self.offsets.items() if 1 + len(found) < self.wanted[space]}


def sound_shadows(spaces: Iterable[SpaceEntry]) -> dict[SpaceId, tuple[SpaceEntry, ...]]:
    """By parent, its shadows in the order of their numbers, but for those that are at no distance, or at that of one before."""
    found: dict[SpaceId, dict[Location, SpaceEntry]] = {}
    for entry in sorted(spaces, key=lambda entry: entry.space):
        if entry.parent and entry.offset != FIRST:
            found.setdefault(entry.parent, {}).setdefault(entry.offset, entry)
    return {parent: tuple(shadows.values()) for parent, shadows in found.items()}


def free_offsets(taken: Iterable[Location], count: int) -> list[Location]:
    """`count` offsets as far as possible from each other, from those that are taken and from 0, in the order of the line.

    The gaps between what is there are cut evenly; each further offset goes where the pieces are widest then, of equal gaps to the first.
    With nothing there, offset i of n - 1 is floor(i * 2^160 / n).
    """
    starts = sorted({0, *(offset.number for offset in taken)})
    widths = [end - start for start, end in zip(starts, [*starts[1:], LINE_LENGTH], strict=True)]
    cuts = [0] * len(starts)
    for _ in range(count):
        widest = max(range(len(starts)), key=lambda gap: (Fraction(widths[gap], cuts[gap] + 1), -gap))
        cuts[widest] += 1
    return [
        Location.from_number(start + step * width // (parts + 1))
        for start, width, parts in zip(starts, widths, cuts, strict=True)
        for step in range(1, parts + 1)
    ]


def check_added(before: Sequence[SpaceEntry], after: Sequence[SpaceEntry]) -> None:
    """Refused if a record that is to be added to a log makes a space or a shadow that only logs of former versions may hold."""
    known = {entry.space: entry for entry in before}
    new_shadows = [entry for entry in after if entry.parent and entry.space not in known]
    sound = sound_shadows(after)
    of_parent = {entry.space: entry for entry in after if not entry.parent}
    for shadow in new_shadows:
        _check_shadow(shadow, of_parent[shadow.parent], after, sound.get(shadow.parent, ()))
    for entry in of_parent.values():
        old = known.get(entry.space)
        if old is None or (old.copies, old.copies_min) != (entry.copies, entry.copies_min):
            check_copies(entry.copies, entry.copies_min)
            shadows = len(sound.get(entry.space, ()))
            if shadows < entry.copies - 1:
                what = f"space {entry.space} shall have {entry.copies} copies, and has {shadows} of the {entry.copies - 1} shadows for them"
                raise _refused(what, "make the shadows in the same record")


def check_copies(copies: int, copies_min: int) -> None:
    """Refused if no space can have so many copies, or ask for so many."""
    if not 1 <= copies_min <= copies <= COPIES_MAX:
        what = f"a space has 1 to {COPIES_MAX} copies, and from 1 to all of them must be there, not {copies_min} of {copies}"
        raise _refused(what, "ask for no more than there shall be")


def _check_shadow(shadow: SpaceEntry, parent: SpaceEntry, all_entries: Sequence[SpaceEntry], sound: Sequence[SpaceEntry]) -> None:
    if shadow.offset == FIRST:
        raise _refused("the offset of a shadow is not 0: its copies would belong where the records are", "give another offset")
    for other in all_entries:
        if other.parent == shadow.parent and other.offset == shadow.offset and other.space != shadow.space:
            raise _refused(f"space {other.space} is a shadow of space {parent.space} with this offset already", "give another offset")
    if (shadow.copies, shadow.copies_min) != (1, 1):
        what = f"a shadow is one copy itself, so it has 1 of 1, not {shadow.copies_min} of {shadow.copies}"
        raise _refused(what, f"say for space {parent.space} how many copies there shall be")
    if len(sound) > parent.copies - 1:
        copies = "1 copy, which takes no shadow" if parent.copies == 1 else f"{parent.copies} copies, and the shadows that those take"
        remedy = "`scenectl space copies` says how many there shall be, and makes the shadows"
        raise _refused(f"space {parent.space} has {copies}", remedy)


def _refused(what: str, remedy: str) -> Refused:
    return Refused(RejectReason.ILL_FORMED, what, where="scene log", remedy=remedy)
