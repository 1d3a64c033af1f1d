"""How healthy a cluster is, by what its nodes say of their copies: what is wrong, where, and what to do about it (specs/20-copies.md, Health). Pure.

Nodes count what they own, so that no record is counted twice. Who does not answer counts nothing: of what it owns nobody knows anything.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from scenefold.client.ailments import MAKE_ROOM, Ailment, ailments_of
from scenefold.client.copy_reports import UNTOLD, CopiesOf, CopiesReport, LossReport
from scenefold.client.health import ClusterStatus, NodeState, shortages
from scenefold.client.listing import some_text
from scenefold.client.own_warnings import Concern
from scenefold.client.reports import NodeReport, ScrubReport
from scenefold.client.shortages import Shortage
from scenefold.client.surroundings import Surroundings, surroundings_of


class Condition(StrEnum):
    HEALTHY = "healthy"
    MENDING = "mending"
    """All copies are there, and something is on its way."""
    DEGRADED = "degraded"


@dataclass(frozen=True, slots=True)
class ClusterHealth:
    """Made by `health_of`."""

    status: ClusterStatus
    ailments: tuple[Ailment, ...]

    @property
    def condition(self) -> Condition:
        if any(ailment.degrades for ailment in self.ailments):
            return Condition.DEGRADED
        return Condition.MENDING if self.ailments else Condition.HEALTHY

    @property
    def shortage(self) -> Shortage | None:
        """Where most copies fail for want of nodes; None if all could be there."""
        return max(shortages(self.status.nodes), key=lambda few: few.missing, default=None)

    @property
    def reports(self) -> list[CopiesReport]:
        return [node.report.copies for node in self.status.nodes if node.report is not None and node.report.copies is not None]

    @property
    def records(self) -> int:
        """All that the nodes that answer own."""
        return sum(copies.owned for copies in self.reports)

    @property
    def under_copied(self) -> int:
        """Records that lie on fewer nodes than they should."""
        return sum(copies.under_copied.records for copies in self.reports)

    @property
    def by_copies(self) -> list[CopiesOf]:
        """What spaces of each number of copies ask for and lack, as far as nodes tell them apart, the lowest number first."""
        told = [of for copies in self.reports for of in copies.by_copies if of.copies != UNTOLD]
        return [_sum(number, [of for of in told if of.copies == number]) for number in sorted({of.copies for of in told})]

    @property
    def mis_placed(self) -> int:
        """Records with a copy where none should be: where placement put it before, or where a blacklist forbids it."""
        return sum(copies.mis_placed.records + copies.forbidden.records for copies in self.reports)

    @property
    def corrupt(self) -> int:
        """Records that have changed on a node's disk, and are not healed."""
        return sum(copies.rotten for copies in self.reports)

    @property
    def pending(self) -> int:
        """Records still to come: owed to nodes, also to those that do not answer, not settled yet, being compared, or being brought home."""
        return sum(pending_of(node.report) for node in self.status.nodes if node.report is not None)

    @property
    def unrecovered(self) -> int:
        """Pieces of the line of which it is not known yet what was acknowledged there."""
        return sum(copies.unrecovered for copies in self.reports)

    @property
    def kept_apart(self) -> int:
        """Records that nodes have brought along from before they were away, and that somebody with their scene's key has to look at."""
        return sum(node.report.kept_apart.records for node in self.status.nodes if node.report is not None)

    @property
    def losses(self) -> list[LossReport]:
        """What may be lost and nobody has acknowledged yet: each once, however many nodes tell it, the oldest first."""
        told = {loss.id: loss for copies in self.reports for loss in copies.lost}
        return sorted(told.values(), key=lambda loss: (loss.noted_s, loss.id))

    @property
    def seconds_to_health(self) -> float | None:
        """0 if nothing is wrong; None if somebody has to do something, or it is not known yet how much there is to be moved, or how fast."""
        if not self.ailments:
            return 0.0
        if any(not ailment.mends_itself or ailment.kind == "unrecovered" for ailment in self.ailments):
            return None
        times = [copies.repair.seconds if copies.repair.records else None for copies in self.reports if _is_at_work(copies)]
        known = [seconds for seconds in times if seconds is not None]
        return max(known) if known and len(known) == len(times) else None

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        return {
            "name": self.status.name,
            "status": str(self.condition),
            "nodes": [_node_document(node) for node in self.status.nodes],
            "records": self.records,
            "records_with_copies": sum(copies.copied for copies in self.reports),
            "by_copies": [of.document() for of in self.by_copies],
            "under_copied": self.under_copied,
            "mis_placed": self.mis_placed,
            "corrupt": self.corrupt,
            "pending": self.pending,
            "unrecovered": self.unrecovered,
            "kept_apart": self.kept_apart,
            "lost": [loss.document() for loss in self.losses],
            "seconds_to_health": self.seconds_to_health,
            "ailments": [ailment.document() for ailment in self.ailments],
        }


def _sum(copies: int, told: list[CopiesOf]) -> CopiesOf:
    return CopiesOf(
        copies,
        records=sum(of.records for of in told),
        under_copied=sum(of.under_copied for of in told),
        missing_max=max(of.missing_max for of in told),
        forbidden=sum(of.forbidden for of in told),
    )


def pending_of(report: NodeReport) -> int:
    """Of what a node owns, or holds in vain, how many copies and records are still to come to where they belong."""
    copies = report.copies
    return report.strays + (0 if copies is None else copies.owed + copies.unsettled + copies.comparing.records)


def health_of(status: ClusterStatus) -> ClusterHealth:
    """Everything that is wrong, what degrades first."""
    around = surroundings_of(status.nodes)
    found = [
        Ailment(warning.kind, warning.address, warning.text, _to_do(warning, around), mends_itself=warning.kind in _MENDS_ITSELF)
        for warning in status.warnings
        # How often damage was met is told there, and here what of it is not healed. What there are too few nodes for degrades here always.
        if warning.degrades and warning.kind not in ("damaged", _TOO_FEW)
    ]
    found += [Ailment(_TOO_FEW, few.address, few.text, few.to_do) for few in shortages(status.nodes)]
    for node in status.nodes:
        found += ailments_of(node, around)
    found += map(_lost, ClusterHealth(status, ()).losses)
    return ClusterHealth(status, tuple(sorted(found, key=lambda ailment: not ailment.degrades)))


_TO_DO = {
    "awaited": "start it, or take it off the line: scenectl cluster revoke",
    "no lease": "start the node that decides the cluster's log, or see what keeps it from answering",
    "gap": "start the nodes beside it that do not answer",
    "overlap": "look at both nodes' logs",
    "nearly full": MAKE_ROOM,
    "handover": "wait; if it lasts, look at both nodes' logs",
}
_MENDS_ITSELF = frozenset({"handover"})
_TOO_FEW = "too few nodes"


def _to_do(warning: Concern, around: Surroundings) -> str:
    if warning.kind != "missing":
        return _TO_DO.get(warning.kind, "")
    if warning.address in around.removable:
        return "start it; if it is gone for ever, wait until it is removed: then others take over what it owned, as far as they have copies"
    if any(node.address == warning.address and node.is_voter for node in around.nodes):
        return "start it: a node that decides the cluster's log is not removed, however long it is away"
    return "start it, or others: as long as so many are away nobody is removed, and nobody takes over what they own"


_LOST = "lost"
_BRING_BACK = (
    "start these machines again with their disks, if there are any left: what they have they bring home; "
    "else restore what is missing, and say that you have seen this: scenectl cluster health --acknowledge"
)


def _lost(loss: LossReport) -> Ailment:
    what = "what was acknowledged last" if loss.complete_copy_left else "what was acknowledged"
    left = "too few of those that held it were left" if loss.complete_copy_left else "no complete copy of it was left"
    text = (
        f"{loss.noted_by}: {what} on {loss.share:.2%} of the line in spaces with {loss.copies} copies may be lost: "
        f"{left} when {some_text(loss.removed)} had been removed"
    )
    return Ailment(_LOST, loss.noted_by, text, _BRING_BACK)


def _is_at_work(copies: CopiesReport) -> bool:
    return bool(copies.under_copied.records or copies.mis_placed.records or copies.forbidden.records or copies.repair.records)


def _node_document(node: NodeState) -> dict[str, Any]:
    report = node.report
    copies = None if report is None or report.copies is None else report.copies.document()
    known = {"address": node.address, "alive": node.alive, "share": node.share, "copies": copies}
    if report is None:
        return {**known, "paused": None, "damaged": None, "strays": None, "strays_more": None, "kept_apart": None, "scrub": None}
    apart, known["paused"] = report.kept_apart.document(), list(report.paused)
    strays = {"strays": report.strays, "strays_more": report.strays_more}
    return {**known, "damaged": report.damaged, **strays, "kept_apart": apart, "scrub": _scrub_document(report.scrub)}


def _scrub_document(scrub: ScrubReport | None) -> dict[str, Any] | None:
    if scrub is None:
        return None
    known = {"round": scrub.round, "fraction": scrub.fraction, "seconds_left": scrub.seconds_left}
    return {**known, "rotten": scrub.rotten, "rotten_before": scrub.rotten_before, "paused": scrub.paused}
