"""What a node says of the copies of what it owns (specs/11-peers.md, Report: `copies`), read into values. Pure."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from scenefold.client.report_values import told_address, told_amount, told_count, told_seconds
from scenefold.wire.loss_packets import LOSS_ID_BYTES

LISTED_MAX = 64
"""No report names more of one kind."""
UNTOLD = 0
"""In place of a number of copies: of all spaces that have any, by a node that does not tell them apart."""


@dataclass(frozen=True, slots=True)
class Part:
    """Some of what a node owns: in so many pieces of its arc, so many records."""

    segments: int = 0
    records: int = 0

    def document(self) -> dict[str, Any]:
        return {"segments": self.segments, "records": self.records}


@dataclass(frozen=True, slots=True)
class ShortageReport:
    """Spaces with so many copies, of which only `possible` can be there. `blacklist_of`: whose; None: there are no other nodes.

    `needed`, `needed_most`: of how many nodes a write is asked for by the least demanding of these spaces, and by the most demanding.
    """

    copies: int
    needed: int
    possible: int
    blacklist_of: str | None
    needed_most: int

    @property
    def forbids_writes(self) -> bool:
        """In some of these spaces."""
        return self.possible < self.needed_most

    @property
    def keeps_forbidden(self) -> bool:
        """Whether copies stay where a blacklist forbids them by now, as nobody may take their place and no write counts."""
        return self.blacklist_of is not None and self.possible < self.needed


@dataclass(frozen=True, slots=True)
class CopiesOf:
    """Of what a node owns in spaces with so many copies. `missing_max`: how many copies those records are short of that lack most."""

    copies: int
    records: int
    under_copied: int
    missing_max: int
    forbidden: int

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        known = {"copies": self.copies, "records": self.records, "under_copied": self.under_copied}
        return {**known, "missing_max": self.missing_max, "forbidden": self.forbidden}


@dataclass(frozen=True, slots=True)
class LossReport:
    """What may be lost with nodes that were removed, as one node noted it and all keep it until it is acknowledged."""

    id: str
    noted_by: str
    """Address of the node that took the place over."""
    noted_s: float
    """Seconds since the epoch, on its clock."""
    copies: int
    """Of the spaces concerned."""
    complete_copy_left: bool
    """Only what was acknowledged last may be missing."""
    share: float
    """Of the line."""
    removed: tuple[str, ...]

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        known = {"id": self.id, "noted_by": self.noted_by, "noted_s": self.noted_s, "copies": self.copies}
        return {**known, "complete_copy_left": self.complete_copy_left, "share": self.share, "removed": list(self.removed)}


@dataclass(frozen=True, slots=True)
class RepairReport:
    """What is still to be brought to holders, as far as that is known; `seconds` None: nothing moves."""

    segments: int
    records: int
    bytes: int
    bytes_per_s: float
    seconds: float | None


@dataclass(frozen=True, slots=True)
class CopiesReport:
    """At the moment of answering. Records that a node owns and that lie there alone by their space's will are in `owned` only."""

    owned: int
    copied: int
    """Those of spaces with copies."""
    under_copied: Part
    missing_max: int
    """How many copies the records that lack most are short of."""
    owed: int
    owed_to_silent: int
    silent: tuple[str, ...]
    """Nodes that are owed records and do not answer, by address."""
    mis_placed: Part
    forbidden: Part
    forbidden_on: tuple[str, ...]
    comparing: Part
    rotten: int
    """Records that have rotted on its disk and are not healed, as far as it knows: they wait for that, or it was given up."""
    unhealed: int
    """Those of them that are given up, or that nobody else has."""
    healed: int
    """Since its start."""
    unsettled: int
    unrecovered: int
    """Pieces of the line of which it does not know yet what was acknowledged there."""
    unrecovered_share: float
    shortages: tuple[ShortageReport, ...]
    repair: RepairReport
    rotten_more: bool = False
    """Whether more have rotted since its start than it can remember: nobody knows how many of these are healed."""
    full: tuple[str, ...] = ()
    """Nodes that had no room for copies of what it owns."""
    full_owed: tuple[str, ...] = ()
    """Those of them that answer and are owed records."""
    lost: tuple[LossReport, ...] = ()
    named_most: tuple[tuple[str, int], ...] = ()
    """Nodes, by address, that name so many pieces that what it took over cannot be recovered; and how many."""
    by_copies: tuple[CopiesOf, ...] = ()
    """What spaces of each number of copies ask for and lack, the lowest number first."""

    def shortage_of(self, of: CopiesOf) -> ShortageReport | None:
        """Why such spaces cannot have all of their copies; None if they can. The worst, if layouts differ."""
        found = (short for short in self.shortages if of.copies in (UNTOLD, short.copies))
        return max(found, key=lambda short: short.copies - short.possible, default=None)

    def is_explained(self, of: CopiesOf) -> bool:
        """Whether none of these records lacks more copies than cannot be there anyway, which is told with what to do."""
        short = self.shortage_of(of)
        return of.missing_max <= (0 if short is None else short.copies - short.possible)

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        repair = self.repair
        return {
            "owned": self.owned,
            "owned_with_copies": self.copied,
            "under_copied": self.under_copied.records,
            "missing_max": self.missing_max,
            "by_copies": [of.document() for of in self.by_copies if of.copies != UNTOLD],
            "owed": self.owed,
            "owed_to_silent": self.owed_to_silent,
            "mis_placed": self.mis_placed.records,
            "forbidden": self.forbidden.records,
            "comparing": self.comparing.records,
            "rotten": self.rotten,
            "rotten_more": self.rotten_more,
            "unhealed": self.unhealed,
            "healed": self.healed,
            "unsettled": self.unsettled,
            "unrecovered": self.unrecovered,
            "full": list(self.full),
            "repair": {
                "segments": repair.segments,
                "records": repair.records,
                "bytes": repair.bytes,
                "bytes_per_s": repair.bytes_per_s,
                "seconds": repair.seconds,
            },
        }


def read_copies(found: Mapping[str, Any] | None) -> CopiesReport | None:
    """Of a report; None if the node says nothing of copies. KeyError, TypeError or ValueError if it says nonsense."""
    if not found:
        return None
    owned, owed, repair, shortages, rotten = found["owned"], found["owed"], found["repair"], found["shortages"], found["rotten"]
    full, lost, by_copies = found.get("full", ()), found.get("lost", ()), found.get("by_copies", ())
    named_most = found["unrecovered"].get("named_most", ())
    if max(map(len, (owed["nodes"], shortages, found["forbidden"]["nodes"], full, lost, by_copies, named_most))) > LISTED_MAX:
        raise ValueError("more than a report names")
    return CopiesReport(
        owned=told_count(owned["records"]),
        copied=told_count(owned["records_with_copies"]),
        under_copied=_part(found["under_copied"]),
        missing_max=told_count(found["under_copied"]["missing_max"]),
        owed=told_count(owed["records"]),
        owed_to_silent=told_count(owed["records_to_silent"]),
        silent=tuple(told_address(node["address"]) for node in owed["nodes"] if not node["alive"]),
        mis_placed=_part(found["mis_placed"]),
        forbidden=_part(found["forbidden"]),
        forbidden_on=tuple(map(told_address, found["forbidden"]["nodes"])),
        comparing=_part(found["comparing"]),
        rotten=told_count(rotten["waiting"]) + told_count(rotten["unhealed"]),
        unhealed=told_count(rotten["unhealed"]),
        healed=told_count(rotten["healed"]),
        unsettled=told_count(found["unsettled"]["records"]),
        unrecovered=told_count(found["unrecovered"]["pieces"]),
        unrecovered_share=told_amount(found["unrecovered"]["share"]),
        shortages=tuple(map(_shortage, shortages)),
        rotten_more=bool(rotten.get("more", False)),
        full=tuple(map(told_address, full)),
        full_owed=tuple(told_address(node["address"]) for node in owed["nodes"] if node["alive"] and node["address"] in full),
        lost=tuple(map(_loss, lost)),
        named_most=tuple((told_address(named["address"]), told_count(named["pieces"])) for named in named_most),
        by_copies=tuple(map(_of, by_copies)) if "by_copies" in found else (_of_all(found),),
        repair=RepairReport(
            told_count(repair["segments"]),
            told_count(repair["records"]),
            told_count(repair["bytes"]),
            told_amount(repair["bytes_per_s"]),
            told_seconds(repair["seconds"]),
        ),
    )


def _part(found: Mapping[str, Any]) -> Part:
    return Part(told_count(found["segments"]), told_count(found["records"]))


def _of(found: Mapping[str, Any]) -> CopiesOf:
    return CopiesOf(*(told_count(found[key]) for key in ("copies", "records", "under_copied", "missing_max", "forbidden")))


def _of_all(found: Mapping[str, Any]) -> CopiesOf:
    under, owned, forbidden = found["under_copied"], found["owned"], found["forbidden"]
    counts = (owned["records_with_copies"], under["records"], under["missing_max"], forbidden["records"])
    return CopiesOf(UNTOLD, *map(told_count, counts))


def _shortage(found: Mapping[str, Any]) -> ShortageReport:
    whose, needed = found["blacklist_of"], told_count(found["needed"])
    return ShortageReport(
        told_count(found["copies"]),
        needed,
        told_count(found["possible"]),
        None if whose is None else told_address(whose),
        told_count(found.get("needed_most", needed)),
    )


def _loss(found: Mapping[str, Any]) -> LossReport:
    name, removed, is_left = found["id"], found["removed"], found["complete_copy_left"]
    if not isinstance(name, str) or not re.fullmatch(f"[0-9a-f]{{{2 * LOSS_ID_BYTES}}}", name):
        raise ValueError("not the id of a loss")
    if not isinstance(is_left, bool) or len(removed) > LISTED_MAX:
        raise ValueError("not a loss")
    return LossReport(
        id=name,
        noted_by=told_address(found["noted_by"]),
        noted_s=told_amount(found["noted_s"]),
        copies=told_count(found["copies"]),
        complete_copy_left=is_left,
        share=told_amount(found["share"]),
        removed=tuple(map(told_address, removed)),
    )
