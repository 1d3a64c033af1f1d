"""Who holds copies where the owner's blacklist forbids it by now, and is kept since nobody may take its place (specs/20-copies.md, Blacklists). Pure.

A blacklist that leaves fewer nodes than any write needs stops writes: nothing new counts on a disk that is forbidden. But what was acknowledged
before would lie with the owner alone as soon as its holders were told to hold it no more, and nobody could copy it instead. So they stay until there are enough others;
those, too, whom the owner has inherited with a piece from one that allowed them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from scenefold.base.cover import without
from scenefold.base.ids import NodeId
from scenefold.base.placement import Layout
from scenefold.peer.copies.configurations import Configurations
from scenefold.peer.replication.placing_wishes import Piece
from scenefold.wire import Member


def with_forbidden(found: Configurations, layout: Layout, pieces: Sequence[Piece], takable: Mapping[NodeId, Member]) -> list[Piece]:
    """What placement gives, and of the members of what is active there, or was when the piece came, as many as there are shadows, forbidden or not.

    `takable`: all other nodes of the cluster. Who was removed is nobody's holder.
    """
    kept: list[Piece] = []
    for arc, holders in pieces:
        rest = [arc]
        for segment in found.segments:
            counts = segment.active(found.me) or segment.newest
            common = segment.arc.intersection(arc) if segment.layout == layout and counts is not None else None
            if common is None or counts is None:
                continue
            rest = [left for part in rest for left in without(part, common)]
            beside = [member for member in counts.members if member not in (found.me, *holders) and takable.get(member.node) == member]
            kept.append((common, (*holders, *beside)[: max(len(layout), len(holders))]))
        kept += [(left, holders) for left in rest]
    return sorted(kept, key=lambda piece: piece[0].first)
