"""The health of a cluster for people: what is wrong, node by node, with what to do, and how long it takes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from scenectl.cluster_text import arc_text
from scenectl.output import and_text, size_text, table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from scenefold.client import ClusterHealth, NodeState, Proof
    from scenefold.client.copy_reports import LossReport
    from scenefold.client.reports import KeptApart

UNKNOWN = "?"


def health_text(found: ClusterHealth, proof: Proof | None = None) -> str:
    """Nodes, what is wrong, and until when. `proof`: what was read of it, and is told below."""
    titles = ("node", "owns", "with copies", "under-copied", "mis-placed", "corrupt", "pending", "unrecovered", "scrubbed")
    notes = [
        f"{node.address} has healed {node.report.copies.healed:,} records that had rotted, since its start: look at its disk"
        for node in found.status.nodes
        if node.report is not None and node.report.copies is not None and node.report.copies.healed
    ]
    for node in found.status.nodes:
        if node.report is not None and node.report.paused:
            notes.append(f"{node.address}: {and_text(node.report.paused)} paused, by an administrator's order")
            notes.append(f"  -> scenectl node upkeep resume {node.address}")
        if node.report is not None and node.report.kept_apart.records:
            notes += [
                _apart(node.address, node.report.kept_apart),
                "  -> `scenectl scene strays NAME` shows them to the members of their scenes",
            ]
    for ailment in found.ailments:
        notes += [ailment.text, f"  -> {ailment.to_do}"] if ailment.to_do else [ailment.text]
    parts = [_summary(found, proof), "", table(titles, map(_row, found.status.nodes)), *_by_copies(found)]
    return "\n".join([*parts, *(["", *notes] if notes else [])])


def _by_copies(found: ClusterHealth) -> list[str]:
    """Where spaces ask for different numbers of copies: what is all that some shall have may be too little for others."""
    if len(found.by_copies) < 2:
        return []
    titles = ("copies asked for", "records", "under-copied", "copies fewer, at most")
    return ["", table(titles, [(of.copies, of.records, of.under_copied, of.missing_max) for of in found.by_copies])]


def seen_text(losses: Sequence[LossReport]) -> str:
    """Which losses were acknowledged just now."""
    lines = [f"acknowledged: what {loss.noted_by} noted, on {loss.share:.2%} of the line" for loss in losses]
    return "\n".join(["", "", *lines]) if lines else ""


def _apart(address: str, apart: KeptApart) -> str:
    scenes = ", ".join(f"{scene} ({count:,})" for scene, count in apart.scenes)
    return f"{address} keeps {apart.records:,} records apart, since it was away while deletions were purged: of scenes {scenes}"


def _summary(found: ClusterHealth, proof: Proof | None) -> str:
    document = found.document()
    records, copied = document["records"], document["records_with_copies"]
    counted = f"{records:,} records, {copied:,} of them in spaces with copies"
    if proof is not None and not proof.is_sound:
        return f"{found.status.name}: degraded: {counted}; what was read says so, below"
    if not found.ailments:
        return f"{found.status.name}: healthy: {counted}, all where they belong, as the nodes say"
    short, degrading = found.shortage, {ailment.kind for ailment in found.ailments if ailment.degrades}
    if short is not None and degrading == {"too few nodes"}:
        rest = "writes are refused where they need more" if short.forbids_writes else "nothing else is wrong"
        whose = f"of what {short.address} owns, " if short.address else ""
        return f"{found.status.name}: degraded, {whose}{short.brief}: {counted}; {rest}"
    if degrading == {"lost"}:
        return f"{found.status.name}: degraded: {counted}; others may be lost"
    seconds = found.seconds_to_health
    is_waiting = seconds is None and all(ailment.mends_itself for ailment in found.ailments)
    return f"{found.status.name}: {found.condition}: {counted}; {'it mends itself' if is_waiting else _time_text(seconds)}"


def _time_text(seconds: float | None) -> str:
    if seconds is None:
        return "how long it takes is not known"
    if seconds < 60:
        return f"healthy in about {max(1.0, seconds):.0f} s"
    return f"healthy in about {seconds / 60:.0f} min" if seconds < 5_400 else f"healthy in about {seconds / 3_600:.1f} h"


def _row(node: NodeState) -> tuple[object, ...]:
    from scenefold.client.cluster_health import pending_of

    report = node.report
    copies = None if report is None else report.copies
    if report is None or copies is None:
        return node.address, "silent" if report is None else UNKNOWN, *[UNKNOWN] * 7
    return (
        node.address,
        copies.owned,
        copies.copied,
        copies.under_copied.records,
        copies.mis_placed.records + copies.forbidden.records,
        copies.rotten,
        f"{pending_of(report)} or more" if report.strays_more else pending_of(report),
        copies.unrecovered,
        UNKNOWN if report.scrub is None else f"{report.scrub.fraction:.0%}",
    )


def proof_text(proof: Proof, losses: Sequence[LossReport] = ()) -> str:
    """What was read, how many copies were valid, and which were not. `losses`: of what may be lost nobody can list the records."""
    from scenefold.client.proof import NAMED_MAX, in_short

    lines = [
        f"Proof: {proof.records:,} records of {len(proof.scenes)} scene{'' if len(proof.scenes) == 1 else 's'}, "
        f"{size_text(proof.bytes)} read in {proof.seconds:.0f} s, {proof.opened:,} records opened as well."
    ]
    for (wanted, valid, domains, elsewhere), count in sorted(proof.counts.items(), reverse=True):
        apart = f"in {domains} failure domain{'' if domains == 1 else 's'}"
        further = f"; {elsewhere} more of each {'lies' if elsewhere == 1 else 'lie'} elsewhere" if elsewhere else ""
        lines.append(f"  {count:,} with {valid} valid of {wanted} copies{' in place' if elsewhere else ''}, {apart}{further}")
    for one in proof.unlisted:
        what = "" if one.space is None else f", in space {one.space} of scene {one.scene}"
        lines.append(f"  not looked at: {arc_text(one.arc)}, which {one.address} owns{what}: {one.why}")
    if not proof.ended:
        lines.append("  interrupted: what comes behind that was not looked at, nor what seemed off for a second time")
    if proof.is_sound and losses:
        return "\n".join(
            [
                *lines,
                "All copies of the records that there are are valid, and where they belong. Others may be lost, as said above: no proof finds these.",
            ]
        )
    if proof.is_sound:
        return "\n".join([*lines, "All copies of all records are valid, and where they belong."])
    counts = {"lost": proof.lost, "short of copies": proof.short, "with corrupt copies": proof.corrupt, "mis-placed": proof.mis_placed}
    counts |= {"with further copies elsewhere": proof.elsewhere}
    if any(counts.values()):
        lines.append("Records " + ", ".join(f"{kind}: {count:,}" for kind, count in counts.items() if count) + ".")
    if proof.elsewhere:
        lines.append("Copies that lie elsewhere are brought home once their owners may take them: what holds that up is said above.")
    found = proof.short + proof.corrupt + proof.mis_placed
    lines += in_short(proof.named)
    return "\n".join([*lines, "and more" if found > len(proof.named) == NAMED_MAX else ""]).rstrip()
