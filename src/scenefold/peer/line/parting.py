"""Whether who leaves may go though copies lie here by right (specs/13-balance.md, Leaving).

Mostly others are placed in its stead, and what lies here comes home. Where so few stay that a write asks for all of them nobody can be
placed: then it may go once its records lie with all the others. Nothing that comes later can be missing there, since each write asks for all.
"""

from __future__ import annotations

from collections.abc import Sequence

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.peer.copies.versions import told_version
from scenefold.peer.line.parts import Parts
from scenefold.peer.line.rightful import layout_of
from scenefold.store import Entry
from scenefold.store.walking import Rightful
from scenefold.wire import HeldRecord, OfferStrays, StraysJudged
from scenefold.world import Priority

BATCH_RECORDS = 256
ASK_S_MAX = 30.0
_LIES_ELSEWHERE = frozenset({0, int(RejectReason.TOO_FEW_COPIES)})


async def lies_with_all_others(parts: Parts) -> bool:
    """Of everything on this disk, by the word of its owners: they have it, and so have all others that may hold it, who are fewer than a write asks for."""
    stay = len(parts.cluster_log.registry.order) - 1
    cursor: bytes | None = None
    while True:
        manifest = await parts.store.strays(Rightful(()), cursor, BATCH_RECORDS)
        if manifest.damaged:
            return False
        for entry in manifest.entries:
            if not await _asks_for_more(parts, entry, stay):
                return False
        by_owner: dict[NodeId, list[Entry]] = {}
        try:
            for entry in manifest.entries:
                by_owner.setdefault(parts.owners.owner_of(entry.home), []).append(entry)
            for owner, entries in sorted(by_owner.items()):
                if not await _answered_for(parts, owner, entries):
                    return False
        except (Refused, Unreachable, PeerFault):
            return False
        cursor = manifest.cursor
        if cursor is None:
            return True


async def _asks_for_more(parts: Parts, entry: Entry, nodes: int) -> bool:
    """Whether a write into the space of a record asks for more nodes than there will be."""
    if not await layout_of(parts, *entry.place[:2]):
        return False
    known = await parts.scenes.known(entry.place.scene, ask=False)
    return known.needed[entry.place.space] > nodes


async def _answered_for(parts: Parts, owner: NodeId, entries: Sequence[Entry]) -> bool:
    headers = await parts.store.record_headers([entry.spot for entry in entries])
    if not all(headers):
        return False
    told = [HeldRecord(*entry.place, entry.object, told_version(header)) for entry, header in zip(entries, headers, strict=True) if header]
    reply = await parts.peers.ask(owner, Priority.LOW, OfferStrays(tuple(told)), StraysJudged, ASK_S_MAX)
    return len(reply.reasons) == len(told) and _LIES_ELSEWHERE.issuperset(reply.reasons)
