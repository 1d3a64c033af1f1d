"""What others bring home, as the owner takes it (specs/12-line.md, Strays).

It is taken like a put: under the lease, in the arc, behind the gate that handovers freeze. It is answered for when all have it that its
space asks for, and never if it lies where its copies belong: whoever brings it then does not know yet what it holds, and would delete a copy.
Of spaces with copies it is asked first what need not be brought at all.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

import trio

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.ids import NodeId
from scenefold.base.limits import STORE_READ_BATCH_MAX
from scenefold.base.location import Arc, Location
from scenefold.base.reasons import RejectReason
from scenefold.crypto import Record, RecordPlace
from scenefold.peer.copies.versions import rank_of, told_version
from scenefold.peer.handlers import Handlers, Senders, node_of
from scenefold.peer.holdings import no_lease
from scenefold.peer.line.parts import Parts
from scenefold.peer.line.receiving import spot_of_item, verified
from scenefold.peer.line.rightful import layout_of
from scenefold.peer.records.copying import NotKept
from scenefold.peer.records.verification import home_of
from scenefold.store import Outcome, Put, PutResult, Spot
from scenefold.wire import (
    HandItem,
    HandRecords,
    HeldRecord,
    OfferStrays,
    Packet,
    PutManyReply,
    PutOutcome,
    SceneMode,
    StraysJudged,
)

GATE_S_MAX = 2.0
"""For a place to thaw; the sender comes back later."""


class _Counted(NamedTuple):
    """A write asks for `needed` nodes; `placed` are to have it beside the owner, and `sure` of these do."""

    needed: int
    placed: int
    sure: int


class TakingHome:
    """Used from the Trio thread only."""

    def __init__(self, parts: Parts) -> None:
        self._parts = parts

    def register(self, handlers: Handlers) -> None:
        handlers.add(HandRecords, self._on_hand, senders=Senders.NODES)
        handlers.add(OfferStrays, self._on_offer, senders=Senders.NODES)

    def _require_registered(self, peer: str) -> None:
        """Refused (12) for a node that was removed and does not know it yet: it is asked of nothing that is purged (specs/22-purge.md, Who was away)."""
        node = node_of(peer)
        if node is None or self._parts.cluster_log.registry.current(node) is None:
            raise Refused(RejectReason.NOT_AUTHORISED, f"{peer} is no member of this cluster, as far as is known here")

    # ------------------------------------------------------------------------------------------------ OfferStrays

    async def _on_offer(self, packet: OfferStrays, peer: str) -> Packet:
        self._require_registered(peer)
        reasons: list[int] = []
        for start in range(0, len(packet.records), STORE_READ_BATCH_MAX):
            part = packet.records[start : start + STORE_READ_BATCH_MAX]
            spots = [Spot(RecordPlace(held.scene, held.space, held.location), held.object) for held in part]
            # All of each is read: who hears that it is here deletes its own.
            present = await self._parts.store.read(spots)
            enough = await self._enough_have(spots)
            all_others = await self._all_others_have(spots, node_of(peer))
            for held, spot, found, is_enough, is_everywhere in zip(part, spots, present, enough, all_others, strict=True):
                has_it = isinstance(found, Record) and rank_of(told_version(found.header_bytes)) >= rank_of(held.version)
                reason = int(await self._why_not_settled_here(held, spot, has_it=has_it))
                stays = await self._why_stays(held, spot.home, peer)
                if stays is None and (reason or is_enough):
                    reasons.append(reason)
                else:
                    reasons.append(int(RejectReason.TOO_FEW_COPIES if not reason and is_everywhere else RejectReason.BUSY))
        return StraysJudged(tuple(reasons))

    async def _why_not_settled_here(self, held: HeldRecord, spot: Spot, *, has_it: bool) -> int:
        """0: this or a newer version is durable here, and may be told. 3: it is to be brought."""
        if not await self._is_placed(held, spot.home):
            # Nobody knows yet who has what: it may be the only one.
            return RejectReason.BUSY
        if not (self._parts.keeper.holding.owns(spot.home) and self._parts.lease.holds()):
            return RejectReason.BUSY
        if not has_it:
            return RejectReason.PEER_MISSED
        return RejectReason.BUSY if self._parts.unsettled.within(Arc(spot.home, spot.home)) else 0

    async def _is_placed(self, held: HeldRecord, home: Location) -> bool:
        """Whether it is known here who holds the copies of a place; none if its space has none."""
        layout = await layout_of(self._parts, held.scene, held.space)
        copies = self._parts.keeper.copies
        if layout is None or not copies.is_recovered(Arc(home, home)):
            return False
        return not layout or copies.configurations.at(layout, home) is not None

    async def _enough_have(self, spots: Sequence[Spot]) -> list[bool]:
        """Whether what lies at each lies with as many as its space asks for, at this moment: since it was acknowledged, some may be gone."""
        nodes = max(1, len(self._parts.cluster_log.registry.order))
        return [one is not None and 1 + one.sure >= min(one.needed, nodes) for one in await self._counted(spots)]

    async def _all_others_have(self, spots: Sequence[Spot], bringer: NodeId | None) -> list[bool]:
        """Whether so few would be left without who brings it that a write asks for all of them, and what lies here lies with all that may hold it."""
        stay = len(self._parts.cluster_log.registry.order) - 1
        return [one is not None and one.needed > stay and one.sure == one.placed for one in await self._counted(spots, bringer)]

    async def _counted(self, spots: Sequence[Spot], but: NodeId | None = None) -> list[_Counted | None]:
        """Of each place: who is to hold what lies there, and has it. None where the space is unknown. `but`: who is not looked at."""
        parts = self._parts
        debtors = await parts.store.debtors_of(spots)
        copies = parts.keeper.copies.configurations
        found: list[_Counted | None] = []
        for spot, owed in zip(spots, debtors, strict=True):
            layout = await layout_of(parts, *spot.place[:2])
            if not layout:
                found.append(None if layout is None else _Counted(1, 0, 0))
                continue
            needed = (await parts.scenes.known(spot.place.scene, ask=False)).needed[spot.place.space]
            segment = copies.at(layout, spot.home)
            placed = [] if segment is None else [member for member in segment.placed(copies.me) if member.node != but]
            sound = [] if segment is None else [member for member in placed if member in segment.sound]
            sure = [member for member in sound if member.node not in owed and not parts.keeper.is_removed(member)]
            found.append(_Counted(needed, len(placed), len(sure)))
        return found

    # ------------------------------------------------------------------------------------------------ HandRecords

    async def _on_hand(self, packet: HandRecords, peer: str) -> Packet:
        self._require_registered(peer)
        verdicts = await verified(self._parts, packet.items)
        problems = [
            verdict if isinstance(verdict, Refused) else await self._why_stays(item, home_of(item), peer)
            for item, verdict in zip(packet.items, verdicts, strict=True)
        ]
        open_ones = [(index, verdict) for index, verdict in enumerate(verdicts) if problems[index] is None and isinstance(verdict, Put)]
        taken = await self._take([packet.items[index] for index, _ in open_ones], [put for _, put in open_ones])
        for (index, _), problem in zip(open_ones, taken, strict=True):
            problems[index] = problem
        enough = await self._enough_have([spot_of_item(item) for item in packet.items])
        few = Refused(RejectReason.BUSY, "too few have it yet that are to have it")
        problems = [problem or (None if is_enough else few) for problem, is_enough in zip(problems, enough, strict=True)]
        outcomes = [
            PutOutcome(0, item.location, NodeId(0))
            if problem is None
            else PutOutcome(int(problem.reason), item.location, self._parts.own.me)
            for item, problem in zip(packet.items, problems, strict=True)
        ]
        return PutManyReply(tuple(map(self._still_so, packet.items, outcomes)))

    async def _why_stays(self, item: HandItem | HeldRecord, home: Location, peer: str) -> Refused | None:
        """Refused (13) if who brings it is counted on to have it: it would delete a copy, not a stray."""
        layout = await layout_of(self._parts, item.scene, item.space)
        copies, node = self._parts.keeper.copies.configurations, node_of(peer)
        segment = None if layout is None else copies.at(layout, home)
        if segment is not None and any(member.node == node for member in segment.counted_on(copies.me)):
            return Refused(RejectReason.BUSY, "it lies by right where it comes from", remedy="let the owner say so")
        return None

    def _still_so(self, item: HandItem, outcome: PutOutcome) -> PutOutcome:
        """What is said of an item at this very moment: while later ones waited, the place or the lease may have gone."""
        parts = self._parts
        if outcome.reason or (parts.keeper.holding.owns(home_of(item)) and parts.lease.holds()):
            return outcome
        return PutOutcome(int(RejectReason.BUSY), outcome.location, parts.own.me)

    async def _take(self, items: Sequence[HandItem], puts: Sequence[Put]) -> list[Refused | None]:
        """Why each is not to be had; None: this or a newer version is durable here, and where else its space asks for it."""
        parts = self._parts
        problems: list[Refused | None] = [Refused(RejectReason.BUSY, "the place is being handed over")] * len(items)
        with trio.move_on_after(GATE_S_MAX if items else 0) as patience:
            async with parts.writing(list(map(home_of, items)), anywhere=any(item.object for item in items)):
                patience.deadline = float("inf")
                awaited = await self._awaited(list(map(spot_of_item, items)))
                problems = [await self._why_not(item, awaited) for item in items]
                open_ones = [index for index, problem in enumerate(problems) if problem is None]
                # All at once, so that they settle together.
                for index, result in zip(open_ones, await parts.keeping.merge([puts[index] for index in open_ones]), strict=True):
                    problems[index] = self._judged(items[index], result)
        return problems

    async def _awaited(self, spots: Sequence[Spot]) -> set[Spot]:
        """Where something has rotted past knowing, and those who have copies of it were not all heard: it may be newer than what is brought."""
        parts = self._parts
        headers = await parts.store.record_headers(spots)
        unknown = [spot for spot, header in zip(spots, headers, strict=True) if header is None]
        found = await parts.store.read(unknown) if unknown else []
        wrecks = [spot for spot, record in zip(unknown, found, strict=True) if isinstance(record, DamagedData)]
        return {spot for spot in wrecks if await parts.keeping.awaits(spot)}

    async def _why_not(self, item: HandItem, awaited: Collection[Spot]) -> Refused | None:
        home = home_of(item)
        try:
            if not self._parts.keeper.holding.owns(home):
                raise Refused(RejectReason.NOT_MY_LOCATION, "the place is not this node's")
            if not self._parts.keeper.copies.is_recovered(Arc(home, home)):
                # It is asked for, among all else. Who brings it has to keep it until then.
                raise Refused(RejectReason.NOT_READY, "not all is known yet that was acknowledged there")
            self._parts.require_lease()
            if spot_of_item(item) in awaited:
                raise Refused(RejectReason.BUSY, "what lay there has rotted, and is being fetched from those who have copies of it")
            await self._check_mode(item)
        except Refused as refusal:
            return refusal
        return None

    def _judged(self, item: HandItem, result: PutResult | NotKept) -> Refused | None:
        if isinstance(result, NotKept):
            return Refused(result.reason, "too few of those that are to have it have it")
        if result.has_changed:
            # What was here already has settled: whoever brings it again and again must not keep us from giving it away.
            home = home_of(item)
            self._parts.settling.note(Arc(home, home))
        if result.outcome not in (Outcome.STORED, Outcome.STALE):
            return Refused(result.reason or RejectReason.STORAGE_FULL, f"it cannot be kept: {result.outcome.value}")
        if not self._parts.lease.holds():
            return no_lease()
        self._parts.events["taken home"] += 1
        return None

    async def _check_mode(self, item: HandItem) -> None:
        """While a scene is rendered, a stray may fill an empty place and replaces nothing; what is here already it may bring at any time."""
        scene = await self._parts.scenes.known(item.scene)
        if scene.public.mode is SceneMode.EDIT:
            return
        (present,) = await self._parts.store.read([spot_of_item(item)])
        if isinstance(present, Record) and rank_of(told_version(item.header)) > rank_of(told_version(present.header_bytes)):
            raise Refused(RejectReason.BUSY, "the scene is being rendered: nothing in it is replaced")
