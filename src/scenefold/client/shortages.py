"""Where fewer copies can be than spaces ask for: why, and what to do about it (specs/20-copies.md, Health). Pure.

Where there are too few nodes all of them say so, and people hear it once. Where a blacklist forbids others, each that has one is named, once,
with the entries that do. Spaces that ask for different numbers of copies are told apart: what is too little for one may be enough for another.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from scenefold.base.ids import node_id_of
from scenefold.base.prefixes import address_prefix
from scenefold.client.copy_reports import CopiesReport, ShortageReport
from scenefold.client.listing import and_text, or_text, some_text


class Rule(NamedTuple):
    """An entry of a blacklist, and the other nodes of the cluster that it forbids."""

    prefix: str
    nodes: tuple[str, ...]

    @property
    def forbids_all(self) -> bool:
        """No node that could be added would be allowed."""
        return address_prefix(self.prefix).bits == 0


@dataclass(frozen=True, slots=True)
class Shortage:
    """Of what the node at `address` owns, or, if that is "", of everything. `told`: one of each number of copies, the lowest first."""

    address: str
    told: tuple[ShortageReport, ...]
    awaited: int = 0
    """Nodes of the cluster that never came."""
    rules: tuple[Rule, ...] = ()
    """What stands on the node's blacklist and forbids others; empty if it is not known."""
    idle: tuple[str, ...] = ()
    """Nodes that own no part of the line: they hold copies only as far as writes need them."""

    @property
    def forbids_writes(self) -> bool:
        return any(told.forbids_writes for told in self.told)

    @property
    def missing(self) -> int:
        """How many nodes would have to be added at least."""
        return max(told.copies - told.possible for told in self.told)

    @property
    def possible(self) -> int:
        """How many copies there can be where they are fewest."""
        return min(told.possible for told in self.told)

    @property
    def brief(self) -> str:
        """Which spaces can have how many copies."""
        numbers = sorted({told.possible for told in self.told})
        spaces = [or_text([str(told.copies) for told in self.told if told.possible == number]) for number in numbers]
        return ", ".join(f"in spaces with {copies} copies only {number} of them" for number, copies in zip(numbers, spaces, strict=True))

    @property
    def text(self) -> str:
        # Spaces of other layouts may need more, or less: it is so of each of them.
        least = min((told.possible for told in self.told if told.forbids_writes), default=None)
        writes = "" if least is None else f", and writes are refused in spaces that need more than {least}"
        if self.address:
            return f"of what {self.address} owns, {self.brief} can be there: {self._forbidding}{writes}"
        possible = self.possible
        nodes = "the cluster has one node" if possible == 1 else f"the cluster has {possible} nodes"
        if self.awaited:
            nodes += f" that {'has' if possible == 1 else 'have'} come, and waits for {self.awaited} more"
        if self.idle:
            have = "owns" if len(self.idle) == 1 else "own"
            nodes += f" that {'owns' if possible == 1 else 'own'} a part of the line; {some_text(self.idle)} {have} none"
        lost = ", and what lies on its disk is lost with it" if possible == 1 and not writes and not self.idle else ""
        return f"{self.brief} can be there: {nodes}{writes}{lost}"

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        known = {"address": self.address or None, "possible": self.possible, "writes_refused": self.forbids_writes}
        return {**known, "text": self.text, "to_do": self.to_do}

    @property
    def _forbidding(self) -> str:
        if not self.rules:
            return f"the blacklist of {self.address} forbids other nodes"
        nodes = some_text(sorted({node for rule in self.rules for node in rule.nodes}, key=node_id_of))
        return (
            f"{and_text([rule.prefix for rule in self.rules])} on its blacklist {'forbids' if len(self.rules) == 1 else 'forbid'} {nodes}"
        )

    @property
    def to_do(self) -> str:
        if self.address:
            return self._to_allow
        if self.forbids_writes:
            return "start the other members, or see what keeps them from coming: scenectl cluster status"
        wait = "start those that have not come yet, or " if self.awaited else ""
        return f"{wait}add {self._so_many_nodes}, and the copies are made: scenectl cluster invite --node"

    @property
    def _to_allow(self) -> str:
        nodes = self._so_many_nodes
        if not self.rules:
            return f"add {nodes} that it allows, or take something off it: scenectl node blacklist rm"
        off = f"take {'it' if len(self.rules) == 1 else 'some of them'} off: scenectl node blacklist rm"
        off += f" {' '.join(rule.prefix for rule in self.rules)} --node {self.address}"
        if any(rule.forbids_all for rule in self.rules):
            return f"{off} (no node that is added would be allowed)"
        return f"{off}; or add {nodes} that it allows: scenectl cluster invite --node"

    @property
    def _so_many_nodes(self) -> str:
        return "a node" if self.missing == 1 else f"{self.missing} nodes"


def rules_of(address: str, blacklist: Iterable[str], nodes: Iterable[str]) -> tuple[Rule, ...]:
    """Which entries of the blacklist of the node at this address forbid any of these nodes."""
    others = [node for node in nodes if node != address]
    found = ((prefix, [node for node in others if address_prefix(prefix).covers(node_id_of(node))]) for prefix in blacklist)
    return tuple(Rule(prefix, tuple(covered)) for prefix, covered in found if covered)


def shortages_of(
    told: Iterable[tuple[str, CopiesReport]],
    awaited: int = 0,
    idle: Sequence[str] = (),
    rules: Callable[[str], tuple[Rule, ...]] = lambda _address: (),
) -> list[Shortage]:
    """By address of the nodes that say so: what is so everywhere first, and of each node one at most.

    `awaited`: nodes that never came. `idle`: nodes that own nothing. `rules`: by what a node's blacklist forbids others.
    """
    few: list[ShortageReport] = []
    forbidden: list[Shortage] = []
    for address, copies in told:
        few += [shortage for shortage in copies.shortages if shortage.blacklist_of is None]
        if own := _worst(shortage for shortage in copies.shortages if shortage.blacklist_of is not None):
            forbidden.append(Shortage(address, own, rules=rules(address)))
    worst = _worst(few)
    return [*([Shortage("", worst, awaited, idle=tuple(idle))] if worst else []), *forbidden]


def _worst(shortages: Iterable[ShortageReport]) -> tuple[ShortageReport, ...]:
    """Of each number of copies the one that leaves fewest; of these the one that needs most."""
    found: dict[int, ShortageReport] = {}
    for one in shortages:
        known = found.get(one.copies)
        if known is None or (one.possible, -one.needed_most) < (known.possible, -known.needed_most):
            found[one.copies] = one
    return tuple(found[copies] for copies in sorted(found))
