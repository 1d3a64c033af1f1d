"""What a node says of the copies of what it owns, in its report (specs/11-peers.md, Report; 20-copies.md, Health).

Records are counted by the store's sums, which take no walk; and only when something has changed since they were counted last, since
whoever watches a cluster asks for reports every second.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import islice
from typing import Any

from scenefold.base.ids import NodeId, address_of
from scenefold.base.location import LINE_LENGTH, Arc
from scenefold.base.placement import Layout
from scenefold.peer.line.parts import Parts
from scenefold.peer.membership.roster import Roster
from scenefold.peer.replication.comparing_progress import Left
from scenefold.peer.replication.healing import Healing
from scenefold.peer.replication.placing import Placing
from scenefold.peer.replication.standing import Standing, by_layout, standing_of
from scenefold.peer.replication.telling_words import members_of
from scenefold.wire import Member

COUNT_AGAIN_S = 2.0
"""Between two counts in a store that is written to all the time."""
ARCS_COUNTED_MAX = 32
"""Of one kind and layout. Of more the last ones are counted with all that lies between them: too many rather than none."""
LISTED_MAX = 16
"""Nodes, or layouts, that a report names of one kind."""


class Health:
    """Used from the Trio thread only."""

    def __init__(
        self,
        parts: Parts,
        roster: Roster,
        placing: Placing,
        healing: Healing,
        left: Callable[[], Left],
        lost: Callable[[], list[dict[str, Any]]] = list,
        crowding: Callable[[], Mapping[NodeId, int]] = dict,
    ) -> None:
        """`crowding`: who names so many pieces that a gap cannot be recovered."""
        self._parts = parts
        self._roster = roster
        self._placing = placing
        self._healing = healing
        self._left = left
        self._lost = lost
        self._crowding = crowding
        self._counted: dict[str, Counter[Layout]] = {}
        self._counted_for: tuple[object, ...] = ()
        self._counted_at = float("-inf")

    async def document(self) -> dict[str, Any]:
        """The part of the report that speaks of copies."""
        parts, is_alive = self._parts, self._roster.is_believed_alive
        copies, arc, layouts = parts.keeper.copies, parts.keeper.holding.arc, dict(self._placing.layouts)
        standing = standing_of(copies, arc, layouts, self._is_there, parts.own.blacklist.prefixes)
        by_layout_counts = await self._counts(standing, arc, layouts)
        counts = {kind: found.total() for kind, found in by_layout_counts.items()}
        owed = {node: count for node, count in parts.store.owed.items() if count}
        most = sorted(owed, key=lambda node: (is_alive(node), -owed[node]))[:LISTED_MAX]
        return {
            "owned": {"records": counts["owned"], "records_with_copies": counts["copied"]},
            "segments": standing.segments,
            "under_copied": {
                "segments": len(standing.lacking),
                "missing_max": standing.copies_missing_max,
                "records": counts["lacking"],
            },
            "owed": {
                "records": sum(owed.values()),
                "records_to_silent": sum(count for node, count in owed.items() if not is_alive(node)),
                "nodes": [{"address": address_of(node), "records": owed[node], "alive": is_alive(node)} for node in most],
            },
            "mis_placed": {"segments": len(standing.moving), "records": counts["moving"]},
            "forbidden": {
                "segments": len(standing.forbidden),
                "records": counts["forbidden"],
                "nodes": _addresses(standing.forbidden_on),
            },
            "comparing": {"segments": len(standing.comparing), "records": counts["comparing"]},
            "by_copies": _by_copies(layouts, standing, by_layout_counts),
            "rotten": {
                "waiting": self._healing.waiting,
                "unhealed": self._healing.unhealed,
                "healed": parts.events["healed"],
                "more": self._healing.has_more,
            },
            "unsettled": {"records": len(parts.unsettled), "pieces": len(parts.unsettled.doubts), "read": parts.unsettled.is_read},
            "unrecovered": {
                "pieces": len(copies.unrecovered),
                "share": sum(gap.length for gap in copies.unrecovered) / LINE_LENGTH,
                "named_most": [{"address": address_of(node), "pieces": count} for node, count in self._most_named()],
            },
            "shortages": [
                {
                    "copies": 1 + len(short.layout),
                    "needed": short.needed,
                    "needed_most": max(short.needed, short.most),
                    "possible": short.possible,
                    "blacklist_of": None if short.whose is None else address_of(short.whose),
                }
                for short in islice(self._placing.shortages.values(), LISTED_MAX)
            ],
            "repair": _left_document(self._left()),
            "full": _addresses(sorted(member.node for member in self._placing.full.among(members_of(copies.configurations)))),
            "lost": self._lost(),
            "held": {
                "segments": len(copies.custody.entries),
                "whole": sum(entry.whole for entry in copies.custody.entries),
            },
        }

    def _most_named(self) -> list[tuple[NodeId, int]]:
        return sorted(self._crowding().items(), key=lambda one: (-one[1], one[0]))[:LISTED_MAX]

    def _is_there(self, member: Member) -> bool:
        return self._roster.is_believed_alive(member.node) and not self._parts.keeper.is_removed(member)

    async def _counts(self, standing: Standing, arc: Arc | None, layouts: Mapping[Layout, int]) -> Mapping[str, Counter[Layout]]:
        store, now = self._parts.store, self._parts.world.clock.now()
        about: tuple[object, ...] = (store.commits, standing, arc, layouts)
        if about == self._counted_for:
            return self._counted
        # In a store that is written to all the time only what is off is worth being counted anew at once.
        if about[1:] == self._counted_for[1:] and now - self._counted_at < COUNT_AGAIN_S:
            return self._counted
        whole = [] if arc is None else [arc]
        kinds: dict[str, Iterable[tuple[Layout, Arc]]] = {
            "lacking": [(one.layout, one.arc) for one in standing.lacking],
            "moving": standing.moving,
            "comparing": standing.comparing,
            "forbidden": standing.forbidden,
            "copied": [(layout, piece) for layout in layouts for piece in whole],
        }
        counts = {kind: await self._records(by_layout(pieces)) for kind, pieces in kinds.items()}
        counts["owned"] = counts["copied"] + await self._records({(): whole})
        self._counted, self._counted_for, self._counted_at = counts, about, now
        return counts

    async def _records(self, arcs: Mapping[Layout, list[Arc]]) -> Counter[Layout]:
        """In all spaces of these layouts, by layout."""
        found = Counter[Layout]()
        if not any(arcs.values()):
            return found
        layout_of = {
            (scene.public.scene, space): layout for scene in self._parts.scenes.everyone() for space, layout in scene.layouts.items()
        }
        for scene, space in await self._parts.store.spaces():
            layout = layout_of.get((scene, space), ())
            wanted = _few(arcs.get(layout, []))
            if wanted:
                found[layout] += sum(total.records for total in await self._parts.store.sums(scene, space, wanted))
        return found


def _by_copies(layouts: Iterable[Layout], standing: Standing, counts: Mapping[str, Counter[Layout]]) -> list[dict[str, int]]:
    """What spaces of each number of copies ask for, and lack: what is too little for one may be all that another one shall have."""
    found = []
    for number in sorted({1 + len(layout) for layout in layouts if layout}):
        of = {kind: sum(count for layout, count in known.items() if 1 + len(layout) == number) for kind, known in counts.items()}
        missing = max((one.missing for one in standing.lacking if 1 + len(one.layout) == number), default=0)
        row = {"copies": number, "records": of["copied"], "under_copied": of["lacking"], "missing_max": missing}
        found.append({**row, "forbidden": of["forbidden"]})
    return found


def _few(arcs: Sequence[Arc]) -> Sequence[Arc]:
    """Not too many that cover these, which are in order."""
    first, rest = arcs[: ARCS_COUNTED_MAX - 1], arcs[ARCS_COUNTED_MAX - 1 :]
    return [*first, Arc(rest[0].first, rest[-1].last)] if rest else first


def _left_document(left: Left) -> dict[str, Any]:
    known = {"segments": left.segments, "records": left.records, "bytes": left.bytes}
    return {**known, "bytes_per_s": left.bytes_per_s, "seconds": left.seconds}


def _addresses(nodes: Iterable[NodeId]) -> list[str]:
    return list(map(address_of, islice(nodes, LISTED_MAX)))
