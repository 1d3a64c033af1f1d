"""What one transaction changes in the trees of digests, gathered and written once at its end (specs/10-store.md, Digests).

A tree that is damaged, or that a folder of an earlier format does not have yet, is built from the records bit by bit, beside all
else that is written. How far it is built stands in a row of its own; what is written behind that is met once the work gets there.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice
from typing import NamedTuple

from scenefold.base.location import LAST
from scenefold.store.digest_tree import Difference, DigestTree, TreeDamaged
from scenefold.store.homes import by_home
from scenefold.store.layout import DIGESTS, SpaceAddress, Spot, space_key, space_of
from scenefold.store.sealing import StoreDamaged
from scenefold.store.versions import stored_sum, sum_of, version_of
from scenefold.world.ports import ReadTransaction, WriteTransaction

_UNBUILT = bytes(4)
"""Before the key of a space: no scene has this id."""
_EVERY_SPACE = b"\xff" * 6

_log = logging.getLogger("scenefold.store")


def built_to(transaction: ReadTransaction, space: SpaceAddress) -> bytes:
    """The last location whose records are in the tree; b"" if none are, the end of the line if all are."""
    try:
        value = transaction.get(DIGESTS, _UNBUILT + space_key(*space))
    except StoreDamaged as damage:
        raise TreeDamaged(space, damage.what) from damage
    return bytes(LAST) if value is None else bytes(value)


def unbuilt_spaces(transaction: ReadTransaction) -> Iterator[SpaceAddress]:
    """Those whose trees do not have all records."""
    for key in transaction.keys(DIGESTS, _UNBUILT, _UNBUILT + _EVERY_SPACE):
        yield space_of(key[len(_UNBUILT) :])


def has_unbuilt(transaction: ReadTransaction) -> bool:
    return next(unbuilt_spaces(transaction), None) is not None


def unbuild(transaction: WriteTransaction, space: SpaceAddress) -> None:
    """Let the tree of a space be built from the beginning."""
    tree = DigestTree(transaction, space)
    for key in tree.everything():
        transaction.delete(DIGESTS, key)
    tree.begin()
    transaction.put(DIGESTS, _UNBUILT + space_key(*space), b"")


class Former(NamedTuple):
    """What lay where something changes: its header, None if that has rotted, and its size as stored."""

    header: bytes | None
    stored_bytes: int


@dataclass(slots=True)
class DigestChanges:
    """By space and home, in the order in which they came."""

    changes: dict[SpaceAddress, dict[bytes, Difference]] = field(default_factory=dict)
    restarts: dict[SpaceAddress, str] = field(default_factory=dict)
    """Of trees that are damaged, and how."""
    to_build: int = 0
    """Records that shall be put into unfinished trees beside."""
    is_unbuilt: bool = False
    """Whether some of these are left, or there are new ones."""

    def change(self, spot: Spot, before: Former | None, after: bytes | None) -> None:
        """A record of this version takes the place of what was there; None for nothing."""
        records, total = 0, 0
        if before is not None:
            if before.header is None:
                self._add(spot, 0, 0, is_lost=True)
                return
            records, total = -1, -sum_of(version_of(before.header))
        if after is not None:
            records, total = records + 1, total + sum_of(after)
        self._add(spot, records, total, is_lost=False)

    def _add(self, spot: Spot, records: int, total: int, *, is_lost: bool) -> None:
        (scene, space, _), home = spot.place, bytes(spot.home)
        homes = self.changes.setdefault((scene, space), {})
        if home in homes:
            _, _, former_records, former_total, was_lost = homes[home]
            records, total, is_lost = former_records + records, former_total + total, was_lost or is_lost
        homes[home] = Difference(home, records, records, total, is_lost)

    def write(self, transaction: WriteTransaction) -> None:
        """Bring the trees up to date, with all records written."""
        for space, reason in self.restarts.items():
            self._restart(transaction, space, reason)
        for space, homes in self.changes.items():
            try:
                built = built_to(transaction, space)
                known = [homes[home] for home in sorted(homes) if home <= built]
                DigestTree(transaction, space, built).apply(known)
            except TreeDamaged as damage:
                self._restart(transaction, space, str(damage))
        if self.to_build:
            self._build(transaction)
            self.is_unbuilt = has_unbuilt(transaction)

    def _restart(self, transaction: WriteTransaction, space: SpaceAddress, reason: str) -> None:
        _log.error("%s; the digests of that space are made anew from its records", reason)
        unbuild(transaction, space)
        self.is_unbuilt = True

    def _build(self, transaction: WriteTransaction) -> None:
        left = self.to_build
        for space in list(islice(unbuilt_spaces(transaction), left)):
            try:
                left -= self._build_on(transaction, space, left)
            except TreeDamaged as damage:
                self._restart(transaction, space, str(damage))
            if left <= 0:
                return

    def _build_on(self, transaction: WriteTransaction, space: SpaceAddress, count: int) -> int:
        """Put at least so many more records into the tree, if there are as many; how many they were."""
        met, end, found = 0, bytes(LAST), list[Difference]()
        found_home = b""
        for home, _key, value in by_home(transaction, space, built_to(transaction, space), end):
            if met >= count and home != found_home:
                end = found_home
                break
            met, found_home = met + 1, home
            total = stored_sum(value)
            if total is not None:
                found.append(Difference(home, 1, 1, total))
        DigestTree(transaction, space, end).apply(found)
        if end == LAST:
            transaction.delete(DIGESTS, _UNBUILT + space_key(*space))
        else:
            transaction.put(DIGESTS, _UNBUILT + space_key(*space), end)
        return max(met, 1)
