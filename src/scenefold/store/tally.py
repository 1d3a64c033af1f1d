"""What the changes of one transaction add up to, written once at its end."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field

from scenefold.store.digest_changes import DigestChanges
from scenefold.store.layout import SpaceAddress, Spot
from scenefold.store.statistics import Counts, change_counts
from scenefold.world.ports import WriteTransaction


@dataclass(slots=True)
class Tally:
    """Differences of what is derived from the records."""

    counts: defaultdict[SpaceAddress, list[int]] = field(default_factory=lambda: defaultdict(lambda: [0, 0]))
    digests: DigestChanges = field(default_factory=DigestChanges)

    def change(self, spot: Spot, before: memoryview | None, header: bytes | None, stored_bytes: int) -> None:
        """A record with this header is about to take the place of a stored value; None for nothing."""
        change = self.counts[spot.place.scene, spot.place.space]
        change[0] += (header is not None) - (before is not None)
        change[1] += stored_bytes - (0 if before is None else len(before))
        self.digests.change(spot, before, header)

    def write(self, transaction: WriteTransaction) -> dict[SpaceAddress, Counts]:
        """Bring what is derived up to date, all records being written; returns the new counts of the spaces that changed."""
        self.digests.write(transaction)
        return {space: change_counts(transaction, space, Counts(*change)) for space, change in self.counts.items()}
