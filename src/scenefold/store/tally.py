"""What the changes of one transaction add up to, written once at its end."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field

from scenefold.base.ids import NodeId
from scenefold.store.debts import DebtChanges
from scenefold.store.digest_changes import DigestChanges, Former
from scenefold.store.layout import SpaceAddress, Spot
from scenefold.store.statistics import Counts, change_counts
from scenefold.world.ports import WriteTransaction


@dataclass(slots=True)
class Tally:
    """Differences of what is derived from the records, and of what is owed of them."""

    counts: defaultdict[SpaceAddress, list[int]] = field(default_factory=lambda: defaultdict(lambda: [0, 0]))
    digests: DigestChanges = field(default_factory=DigestChanges)
    debts: DebtChanges = field(default_factory=DebtChanges)

    def change(self, spot: Spot, before: Former | None, version: bytes | None, stored_bytes: int) -> None:
        """A record of this version takes the place of what was there; None for nothing."""
        change = self.counts[spot.place.scene, spot.place.space]
        change[0] += (version is not None) - (before is not None)
        change[1] += stored_bytes - (0 if before is None else before.stored_bytes)
        self.digests.change(spot, before, version)

    def write(self, transaction: WriteTransaction) -> tuple[dict[SpaceAddress, Counts], dict[NodeId, int]]:
        """Bring what is derived up to date, all records being written; the new counts of spaces, and of what nodes are owed, that changed."""
        self.digests.write(transaction)
        counts = {space: change_counts(transaction, space, Counts(*change)) for space, change in self.counts.items()}
        return counts, self.debts.write(transaction)
