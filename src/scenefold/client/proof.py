"""What was found when all copies of records were read: how many of each are valid, on which nodes, in how many failure domains (specs/20-copies.md, Health). Pure."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, NamedTuple

from scenefold.base.ids import NodeId, SpaceId, address_of
from scenefold.base.location import LINE_LENGTH, Arc
from scenefold.client.listing import some_text
from scenefold.client.verifying import Key

NAMED_MAX = 20
"""Records that are named; all are counted."""


class Verdict(StrEnum):
    """What one node has of a record."""

    VALID = "valid"
    OLDER = "older"
    """Genuine, and another node has a newer version."""
    ELSEWHERE = "elsewhere"
    """Genuine, and no older than what lies where it belongs; but it lies where it does not, and is to be brought home."""
    NOTHING = "nothing"
    CORRUPT = "corrupt"
    """It is damaged, or is not what a writer of the scene has signed."""
    SILENT = "silent"


@dataclass(frozen=True, slots=True)
class Finding:
    """One record, with what each node that was asked has of it. `placed`: who should have it, the owner first."""

    scene: str
    key: Key
    wanted: int
    placed: tuple[NodeId, ...]
    verdicts: Mapping[NodeId, Verdict]
    domains: int
    forbidden: frozenset[NodeId] = frozenset()
    """Nodes that the owner's blacklist covers."""
    is_opened: bool = False
    """Its payload was decrypted, too."""
    is_owner_sure: bool = True
    """Who answered as its owner says that it is."""

    @property
    def valid(self) -> list[NodeId]:
        return [node for node, verdict in self.verdicts.items() if verdict is Verdict.VALID]

    @property
    def elsewhere(self) -> list[NodeId]:
        return [node for node, verdict in self.verdicts.items() if verdict is Verdict.ELSEWHERE]

    @property
    def is_gone(self) -> bool:
        """It was deleted for good, or moved, since it was listed: nobody has anything of it."""
        return set(self.verdicts.values()) <= {Verdict.NOTHING}

    @property
    def is_short(self) -> bool:
        return len(self.valid) < self.wanted

    @property
    def is_lost(self) -> bool:
        """No node that answers has it sound."""
        return not self.valid and not self.elsewhere

    @property
    def is_corrupt(self) -> bool:
        return Verdict.CORRUPT in self.verdicts.values()

    @property
    def is_mis_placed(self) -> bool:
        """Enough copies are there, and one lies where none should, or is not where it should be."""
        valid = set(self.valid)
        return not self.is_short and not (valid.isdisjoint(self.forbidden) and valid.issuperset(self.placed))

    @property
    def is_sound(self) -> bool:
        return self.is_owner_sure and not (self.is_short or self.is_corrupt or self.is_mis_placed)

    @property
    def is_worth_another_look(self) -> bool:
        """Whether it may only seem off because bounds and records move while they are read."""
        off = {verdict for verdict in self.verdicts.values() if verdict is not Verdict.VALID}
        return not self.is_owner_sure or (not self.is_sound and off != {Verdict.SILENT})

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        kinds = (("lost", self.is_lost), ("short", self.is_short), ("corrupt", self.is_corrupt), ("mis-placed", self.is_mis_placed))
        return {
            "scene": self.scene,
            "space": self.key[0],
            "location": self.key[1].hex(),
            "object": self.key[2].hex() if len(self.key) == 3 else None,
            "problems": [kind for kind, is_so in kinds if is_so],
            "wanted": self.wanted,
            "valid": len(self.valid),
            "elsewhere": len(self.elsewhere),
            "domains": self.domains,
            "nodes": {address_of(node): str(verdict) for node, verdict in sorted(self.verdicts.items())},
        }


class Unlisted(NamedTuple):
    """A part of the line of which it is not known what lies there. `space` None: in no space."""

    address: str
    arc: Arc
    why: str
    scene: str = ""
    space: SpaceId | None = None


@dataclass(slots=True)
class Proof:
    """All findings, added up."""

    scenes: tuple[str, ...] = ()
    records: int = 0
    bytes: int = 0
    """That were read, of all copies."""
    counts: Counter[tuple[int, int, int, int]] = field(default_factory=Counter)
    """How many records have so many copies wanted, valid ones, failure domains of these, and further copies elsewhere."""
    short: int = 0
    lost: int = 0
    corrupt: int = 0
    mis_placed: int = 0
    elsewhere: int = 0
    """Short ones of which further copies lie where they do not belong."""
    opened: int = 0
    named: list[Finding] = field(default_factory=list)
    unlisted: list[Unlisted] = field(default_factory=list)
    seconds: float = 0.0
    ended: bool = False
    """Else it goes on still, or was interrupted."""

    def add(self, finding: Finding) -> None:
        if finding.is_gone:
            return
        self.records += 1
        self.counts[finding.wanted, len(finding.valid), finding.domains, len(finding.elsewhere)] += 1
        self.short += finding.is_short
        self.lost += finding.is_lost
        self.corrupt += finding.is_corrupt
        self.mis_placed += finding.is_mis_placed
        self.elsewhere += bool(finding.elsewhere)
        self.opened += finding.is_opened
        if (finding.is_short or finding.is_corrupt or finding.is_mis_placed) and len(self.named) < NAMED_MAX:
            self.named.append(finding)

    @property
    def is_complete(self) -> bool:
        """Whether everything that there is was looked at."""
        return self.ended and not self.unlisted

    @property
    def is_sound(self) -> bool:
        return self.is_complete and not (self.short or self.corrupt or self.mis_placed)

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        return {
            "sound": self.is_sound,
            "complete": self.is_complete,
            "scenes": list(self.scenes),
            "records": self.records,
            "bytes_read": self.bytes,
            "opened": self.opened,
            "copies": [
                {"wanted": wanted, "valid": valid, "domains": domains, "elsewhere": elsewhere, "records": count}
                for (wanted, valid, domains, elsewhere), count in sorted(self.counts.items(), reverse=True)
            ],
            "short": self.short,
            "lost": self.lost,
            "corrupt": self.corrupt,
            "mis_placed": self.mis_placed,
            "elsewhere": self.elsewhere,
            "named": [finding.document() for finding in self.named],
            "unlisted": [
                {
                    "address": one.address,
                    "first": one.arc.first.hex(),
                    "last": one.arc.last.hex(),
                    "share": one.arc.length / LINE_LENGTH,
                    "why": one.why,
                    "scene": one.scene or None,
                    "space": one.space,
                }
                for one in self.unlisted
            ],
            "seconds": self.seconds,
        }


def domains_of(nodes: Collection[NodeId], keeps_away: Callable[[NodeId, NodeId], bool]) -> int:
    """In how many failure domains these nodes are. `keeps_away`: the first one's blacklist covers the second, so both may fail together."""
    left = set(nodes)
    found = 0
    while left:
        found += 1
        reached = [left.pop()]
        for node in reached:
            together = {other for other in left if keeps_away(node, other) or keeps_away(other, node)}
            left -= together
            reached += together
    return found


def newest_alone(verdicts: Mapping[NodeId, Verdict], versions: Mapping[NodeId, Any]) -> dict[NodeId, Verdict]:
    """With what is genuine and older than others told apart. `versions`: of what is genuine, in an order.

    What lies elsewhere makes nothing older that lies where it belongs: it may be what its owner has refused.
    """
    in_place = [versions[node] for node, verdict in verdicts.items() if verdict is Verdict.VALID]
    newest = max(in_place or versions.values(), default=None)
    return {node: Verdict.OLDER if node in versions and versions[node] < newest else verdict for node, verdict in verdicts.items()}


def valid_text(elsewhere: int) -> str:
    """What valid copies are, where so many further ones lie elsewhere."""
    if not elsewhere:
        return "valid"
    return f"valid in place, {elsewhere} more {'copy lies' if elsewhere == 1 else 'copies lie'} elsewhere"


def in_short(findings: Iterable[Finding]) -> list[str]:
    """A line for each: where, and what each node has."""
    lines = []
    for finding in findings:
        key = finding.key
        place = f"object {key[2].hex()}" if len(key) == 3 else key[1].hex()
        said = ", ".join(f"{address_of(node)} {verdict}" for node, verdict in sorted(finding.verdicts.items()))
        problems = ", ".join(finding.document()["problems"])
        found = f"{len(finding.valid)} of {finding.wanted} {valid_text(len(finding.elsewhere))}"
        found += f" on {some_text(map(address_of, sorted(finding.elsewhere)))}" if finding.elsewhere else ""
        lines.append(f"scene {finding.scene}, space {key[0]}, {place}: {problems}: {found} ({said})")
    return lines
