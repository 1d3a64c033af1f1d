"""What is wrong with a store, where, and what helps (specs/21-verify.md)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from enum import StrEnum
from typing import NamedTuple

from scenefold.base.ids import NodeId, address_of
from scenefold.base.location import LOCATION_BYTES
from scenefold.base.printable import printable
from scenefold.store.layout import DEBTORS, DEBTS, HOLDING, IDENTITY, LOGS, NOTES, RECORDS, SPACE_BYTES, Spot, scene_of, space_of, spot_of
from scenefold.store.log_rows import log_named
from scenefold.store.statistics import Counts
from scenefold.store.walking import describe
from scenefold.world.ports import WriteTransaction

LISTED_MAX = 1_000
"""Findings that are told one by one. All are counted."""
SCENE_BYTES = _NODE_BYTES = 4
_BY_NAME = HOLDING, NOTES, IDENTITY

Fix = Callable[[WriteTransaction], None]
"""A change that mends something."""


class Helps(StrEnum):
    """What helps."""

    MEND = "mend"
    """It follows from something else, and is made anew from that."""
    FETCH = "fetch"
    """Other nodes have it."""
    WIPE = "wipe"
    """Nobody else has it, and the node cannot go on without it."""


class Finding(NamedTuple):
    """One thing that is wrong. `fix`: what repair does about it; None if it can do nothing, or need not."""

    table: str
    where: str
    what: str
    helps: Helps
    fix: Fix | None = None
    spot: Spot | None = None
    """Of a record that other nodes have."""


@dataclass(slots=True)
class Findings:
    """What a look at a whole store has brought to light. `signatures`: records whose signature was looked at."""

    listed: list[Finding] = field(default_factory=list)
    counts: Counter[Helps] = field(default_factory=Counter)
    fixes: list[Finding] = field(default_factory=list)
    rotten: list[Spot] = field(default_factory=list)
    records: Counts = field(default_factory=Counts)
    signatures: int = 0

    def add(self, finding: Finding) -> None:
        self.counts[finding.helps] += 1
        if len(self.listed) < LISTED_MAX:
            self.listed.append(finding)
        if finding.fix is not None:
            self.fixes.append(finding)
        if finding.spot is not None:
            self.rotten.append(finding.spot)

    def add_all(self, findings: Iterable[Finding]) -> None:
        for finding in findings:
            self.add(finding)

    @property
    def is_sound(self) -> bool:
        return not self.counts

    @property
    def left_out(self) -> int:
        """Findings that are counted and not listed."""
        return self.counts.total() - len(self.listed)


def named(table: str, key: bytes) -> str:
    """The place of a value, for people."""
    if table in _BY_NAME:
        return printable(key.decode(errors="replace"))
    if table == LOGS:
        return log_named(key)
    if table == DEBTORS and len(key) == _NODE_BYTES:
        return f"node {address_of(NodeId(int.from_bytes(key, 'big')))}"
    if len(key) == SCENE_BYTES:
        return f"scene {scene_of(key):08x}"
    if table in (RECORDS, DEBTS) and len(key) >= SPACE_BYTES + LOCATION_BYTES:
        return describe(spot_of(key))
    if len(key) < SPACE_BYTES:
        return key.hex()
    (scene, space), rest = space_of(key), key[SPACE_BYTES:].hex()
    return f"scene {scene:08x}, space {space}" + (f", {rest}" if rest else "")
