"""Which version of a record this client has met, and whether it is led back behind it (specs/18-data.md, Setbacks).

While a record has one copy, its owner can hold it back, or give an older version that is as well signed, and a lost disk looks
the same. A client cannot prevent that. But what it has read, or was told to be durable, it remembers for a while, so that it notices.
"""

from __future__ import annotations

import logging
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass

from scenefold.client.sealing import Opened
from scenefold.client.verifying import Key
from scenefold.crypto.record_header import Version
from scenefold.world import QuietLog

PLACES_MAX = 16_384
"""Records whose versions are remembered, the last that were met: some 8 MB."""

_log = logging.getLogger("scenefold.client")


@dataclass(slots=True)
class _Met:
    version: Version
    is_deleted: bool
    moment: int
    is_missing: bool = False
    """Nothing was there when it was looked for last."""
    setbacks: int = 0


class Setbacks:
    """Of one scene. Moments number what was met, since what was met while a question was under way says nothing of its answer."""

    def __init__(self) -> None:
        self.count = 0
        """How often this client was led back."""
        self._met: OrderedDict[tuple[int, bytes], _Met] = OrderedDict()
        self._shown: OrderedDict[tuple[int, bytes], _Met] = OrderedDict()
        """What nodes that need not know have shown: nobody has said that it counts, and yet nobody is to see it go back to what was before."""
        self._moment = 0
        self._quiet = QuietLog(_log)

    def moment(self) -> int:
        """To be taken before a question is asked."""
        return self._moment

    def wrote(self, key: Key, version: Version, *, is_deleted: bool) -> None:
        """A node has said that this is durable."""
        self._meets(key, version, is_deleted=is_deleted)

    def read(self, keys: Sequence[Key], found: Sequence[Opened | None], asked_at: int) -> list[Key]:
        """What an owner under its lease answered, verified; those of them that are behind what was met before the question."""
        behind = [key for key, one in zip(keys, found, strict=True) if self._leads_back(key, one, asked_at)]
        for key in keys:
            # Whatever others have shown, that is what there is.
            self._shown.pop((key[0], key[-1]), None)
        self.count += len(behind)
        return behind

    def is_behind(self, key: Key, found: Opened | None, asked_at: int) -> bool:
        """Whether one node's word, asked for at that moment, is older than what was met or shown."""
        known = self._met.get((key[0], key[-1])), self._shown.get((key[0], key[-1]))
        return any(met is not None and met.moment <= asked_at and _is_behind(found, met) for met in known)

    def showed(self, key: Key, found: Opened | None) -> None:
        """A user sees one node's word, or an owner's that may have been replaced. It is no setback if another one is older."""
        name = key[0], key[-1]
        before = self._shown.get(name)
        if found is None or (before is not None and found.version < before.version):
            return
        self._moment += 1
        self._shown[name] = _Met(found.version, found.deleted, self._moment)
        self._shown.move_to_end(name)
        if len(self._shown) > PLACES_MAX:
            self._shown.popitem(last=False)

    def of(self, key: Key) -> int:
        """How often a record was found behind, as far as that is remembered."""
        met = self._met.get((key[0], key[-1]))
        return 0 if met is None else met.setbacks

    def ends_deleted(self, key: Key) -> bool:
        """Whether the newest that this client has met there is a deletion. That nothing was there any more is none."""
        met = self._met.get((key[0], key[-1]))
        return met is not None and met.is_deleted

    def tell(self, now: float, where: str, behind: Sequence[Key]) -> None:
        """Warn of them, once a minute at most."""
        text = (
            f"{len(behind)} records are gone, or older than this client has met them, the first in space {behind[0][0]} at {behind[0][-1].hex()}: "
            "their disk was lost, or their owner holds them back"
        )
        self._quiet.say(now, where, "setback", text)

    def _leads_back(self, key: Key, found: Opened | None, asked_at: int) -> bool:
        met = self._met.get((key[0], key[-1]))
        is_behind = met is not None and met.moment <= asked_at and _is_behind(found, met)
        if met is not None and is_behind:
            # From here on that is what there is, so it is told once; but again if what was missing was shown meanwhile.
            met.setbacks += 1
            met.is_missing = found is None
            if found is not None:
                met.version, met.is_deleted = found.version, found.deleted
        elif found is not None:
            self._meets(key, found.version, is_deleted=found.deleted)
        return is_behind

    def _meets(self, key: Key, version: Version, *, is_deleted: bool) -> None:
        name = key[0], key[-1]
        self._moment += 1
        met = self._met.get(name)
        if met is None:
            self._met[name] = _Met(version, is_deleted, self._moment)
            if len(self._met) > PLACES_MAX:
                self._met.popitem(last=False)
            return
        self._met.move_to_end(name)
        if met.version < version or (met.version == version and met.is_missing):
            met.version, met.is_deleted, met.moment, met.is_missing = version, is_deleted, self._moment, False


def _is_behind(found: Opened | None, met: _Met) -> bool:
    """Nothing at all where something deleted was is nothing lost."""
    return not (met.is_deleted or met.is_missing) if found is None else found.version < met.version
