"""Whether what went with disks that are gone is said by nodes, and what they say has a cause (specs/17-simulation.md, Copies)."""

from __future__ import annotations

from collections.abc import Iterable

from scenefold.base.location import Arc
from scenefold.simulation.cluster import Cluster
from scenefold.simulation.history import Place


def judge_notes(cluster: Cluster) -> None:
    """At the end: count the places of spaces with copies that lost what may have been told, by whether a node says so."""
    watch = cluster.watch
    kept = [loss for node in cluster.nodes.values() if node.context is not None for loss in node.context.replication.noting.kept]
    notes = {(loss.noted_by, loss.arcs, loss.removed): loss for loss in kept}
    spans = {about: [span.arc for span in loss.arcs] for about, loss in notes.items()}
    for place in watch.vanished:
        is_noted = any(place.home in arc for arcs in spans.values() for arc in arcs)
        by_rot = not is_noted and place in watch.keeping.by_rot
        watch.counts["losses noted" if is_noted else "losses by rot" if by_rot else "losses not noted"] += 1
        if not is_noted and not by_rot:
            watch.story.tell(watch._now(), None, "what was lost there no node says", location=place.location)
    watch.counts["notes"] += len(notes)
    watch.counts["notes without a loss"] += sum(not _has_any(arcs, watch.vanished) for arcs in spans.values())


def _has_any(arcs: Iterable[Arc], places: Iterable[Place]) -> bool:
    return any(place.home in arc for place in places for arc in arcs)
