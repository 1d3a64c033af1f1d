"""Where fewer copies can be than spaces shall have: why, and what to do about it (specs/20-copies.md, Health). Pure.

Where there are too few nodes all of them say so, and people hear it once. Where a blacklist forbids others, each that has one is named, once.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from scenefold.client.copy_reports import CopiesReport, ShortageReport


@dataclass(frozen=True, slots=True)
class Shortage:
    """Of what the node at `address` owns, or, if that is "", of everything."""

    address: str
    told: ShortageReport
    awaited: int = 0
    """Nodes of the cluster that never came."""

    @property
    def forbids_writes(self) -> bool:
        return self.told.forbids_writes

    @property
    def missing(self) -> int:
        """How many nodes would have to be added at least."""
        return self.told.copies - self.told.possible

    @property
    def text(self) -> str:
        told, possible = self.told, self.told.possible
        # Spaces of other layouts may need more, or less: it is so of each of them.
        writes = f", and writes are refused in spaces that need more than {possible}" if self.forbids_writes else ""
        if self.address:
            return (
                f"only {possible} of {told.copies} copies of what {self.address} owns can be there: "
                f"the blacklist of {told.blacklist_of} forbids other nodes{writes}"
            )
        nodes = "the cluster has one node" if possible == 1 else f"the cluster has {possible} nodes"
        if self.awaited:
            nodes += f" that {'has' if possible == 1 else 'have'} come, and waits for {self.awaited} more"
        lost = ", and what lies on its disk is lost with it" if possible == 1 and not writes else ""
        return f"only {possible} of {told.copies} copies of each record can be there: {nodes}{writes}{lost}"

    @property
    def to_do(self) -> str:
        if self.address:
            return "add nodes that it allows, or take something off it: scenectl node blacklist rm"
        if self.forbids_writes:
            return "start the other members, or see what keeps them from coming: scenectl cluster status"
        nodes = "a node" if self.missing == 1 else f"{self.missing} nodes"
        wait = "start those that have not come yet, or " if self.awaited else ""
        return f"{wait}add {nodes}, and the copies are made: scenectl cluster invite --node"


def shortages_of(told: Iterable[tuple[str, CopiesReport]], awaited: int = 0) -> list[Shortage]:
    """By address of the nodes that say so: what is so everywhere first, and of each the worst alone. `awaited`: nodes that never came."""
    few: list[Shortage] = []
    forbidden: list[Shortage] = []
    for address, copies in told:
        few += [Shortage("", shortage, awaited) for shortage in copies.shortages if shortage.blacklist_of is None]
        forbidden += _worst(Shortage(address, shortage) for shortage in copies.shortages if shortage.blacklist_of is not None)
    return [*_worst(few), *forbidden]


def _worst(shortages: Iterable[Shortage]) -> list[Shortage]:
    """Where spaces shall have different numbers of copies, there is one thing to do about all of them."""
    worst = max(shortages, key=lambda one: (one.forbids_writes, one.missing), default=None)
    return [] if worst is None else [worst]
