"""What is read for images is frozen, and modes do not overlap: guarantee R and I7, judged by what nodes, clients and disks do
(specs/17-simulation.md, Logs). Pure.

Its moments are those of the histories. `epoch` is the position that a record's author signed it at: the first of what orders versions.
"""

from __future__ import annotations

import bisect
import itertools
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import NamedTuple

from scenefold.simulation import laws
from scenefold.simulation.history import Digest, Place, Version
from scenefold.simulation.lineage import Holder
from scenefold.simulation.log_history import Wrong
from scenefold.wire import SceneMode

Name = Callable[[Holder], str]


class Acting(NamedTuple):
    """A mode that is active for a node: of the scene as it was decided at `position`, or at any position below it."""

    who: str
    position: int


@dataclass(frozen=True, slots=True)
class Look:
    """A place as it was read first at a position: what was there, what lay on disks then, and who owned it."""

    who: str
    seen: Digest | None
    there: frozenset[Digest | None]
    owner: Holder | None


class Frozen:
    """Of one scene and one run."""

    def __init__(self, moment: Callable[[], int]) -> None:
        self._moment = moment
        self._modes: dict[int, SceneMode] = {}
        self._floors: dict[Holder, list[tuple[int, int]]] = {}
        """By node: when it found first that nothing of below a floor comes in any more, and which floor, ever higher."""
        self._came: dict[tuple[Holder, Place], tuple[Digest, int]] = {}
        """What lies there, and since when."""
        self._looks: dict[tuple[int, Place], Look] = {}
        self.edits: set[Digest] = set()
        """What was acknowledged to its author."""
        self.looks = self.moved = 0
        """Records read for images; and how many of these were others than before, that had come home, or from another owner."""

    # ------------------------------------------------------------------------------------------------------- modes

    def decided(self, position: int, mode: SceneMode) -> None:
        """This is the scene's mode as of this position."""
        self._modes.setdefault(position, mode)

    @property
    def switches(self) -> list[int]:
        """The positions that changed it, as far as they are known."""
        known = sorted(self._modes)
        return [after for before, after in itertools.pairwise(known) if self._modes[before] is not self._modes[after]]

    def acts(self, who: str, what: str, leased: int, active: Iterable[Acting]) -> list[Wrong]:
        """Somebody signs an edit, or renders, under a lease of this position, while these modes are active."""
        found, switches = [], [0, *self.switches]
        for mode in active:
            newest = switches[bisect.bisect_right(switches, mode.position) - 1]
            if newest > leased:
                words = f"{who} {what} under a lease of position {leased}, and {mode.who} acts by the mode of position {newest} already"
                found.append(Wrong(laws.MODES_APART, words))
        return found

    # ----------------------------------------------------------------------------------------------------- fencing

    def fenced(self, node: Holder, floor: int) -> None:
        """A node is about to answer a reader: nothing of below this floor comes in there any more."""
        floors = self._floors.setdefault(node, [])
        if not floors or floors[-1][1] < floor:
            floors.append((self._moment(), floor))

    def came(self, node: Holder, place: Place, version: Version) -> None:
        """A version has just become durable on a node's disk."""
        self._came[node, place] = version.digest, self._moment()

    def taken(self, node: Holder, place: Place, version: Version) -> list[Wrong]:
        """A node acknowledges an edit to its author."""
        self.edits.add(version.digest)
        digest, since = self._came.get((node, place), (b"", 0))
        if digest != version.digest:
            # Another one lies over it by now; when this one came is not known any more.
            return []
        for moment, floor in self._floors.get(node, ()):
            if moment < since and version.order[0] < floor:
                words = f"n{node.slot} takes an edit of position {version.order[0]}, and had answered a reader of floor {floor} before"
                return [Wrong(laws.FROZEN, words)]
        return []

    # ----------------------------------------------------------------------------------------------------- reading

    def looked(
        self, who: str, floor: int, place: Place, version: Version | None, there: Callable[[], Iterable[Digest]], owner: Holder | None
    ) -> list[Wrong]:
        """Somebody who renders at this floor is given this. `there`: what lies there on any disk. `owner`: whose word it is."""
        self.looks += 1
        if version is not None and version.order[0] >= floor:
            return [Wrong(laws.FROZEN, f"{who} renders at {floor}, and reads an edit of position {version.order[0]}")]
        digest = None if version is None else version.digest
        known = self._looks.get((floor, place))
        if known is None:
            self._looks[floor, place] = Look(who, digest, frozenset((digest, None, *there())), owner)
            return []
        if digest == known.seen:
            return []
        if digest in known.there or owner != known.owner:
            self.moved += 1
            return []
        words = f"{who} renders at {floor}, and reads {_name(digest)} where {known.who} read {_name(known.seen)} at that position"
        return [Wrong(laws.FROZEN, f"{words}: nothing of it was on any disk then")]


def _name(digest: Digest | None) -> str:
    return "nothing" if digest is None else digest.hex()[:6]
