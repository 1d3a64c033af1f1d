"""What lies in a gap that was seen before (specs/12-line.md, Adoption). Pure.

Between two looks nobody but the node that looks can come to own a place of its gap, as long as its own holding does not change. So the
leases to be waited for are those of nodes that were removed before the first look: whoever comes and goes later puts nothing off.
"""

from __future__ import annotations

from dataclasses import dataclass

from scenefold.base.location import Arc


@dataclass(frozen=True, slots=True)
class Sighting:
    """At `moment`, or later, all of `gap` had no owner, and our holding had this revision and an arc beside it."""

    gap: Arc
    revision: int
    moment: float


class Sightings:
    """Kept in memory only: of one revision, so at most one gap on either side of our arc."""

    def __init__(self) -> None:
        self._known: tuple[Sighting, ...] = ()

    def see(self, gap: Arc, revision: int, now: float) -> Sighting:
        """A look has found a gap beside our arc. What of it was known, since the first look; or all of it, since now."""
        same = [known for known in self._known if known.revision == revision]
        elsewhere = [known for known in same if known.gap.intersection(gap) is None]
        seen = Sighting(gap, revision, now)
        for known in same:
            common = known.gap.intersection(gap)
            seen = seen if common is None else Sighting(common, revision, known.moment)
        self._known = (*elsewhere, seen)
        return seen
