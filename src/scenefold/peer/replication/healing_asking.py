"""Others are asked what they have where a record has rotted on this node's disk (specs/20-copies.md, Healing)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import NamedTuple

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.reasons import RejectReason
from scenefold.peer.copies.versions import Rank, rank_of
from scenefold.peer.line.parts import Parts
from scenefold.peer.replication.healing_sources import Sources
from scenefold.store import Spot
from scenefold.store.debts import Debt
from scenefold.wire import ArcSum, CompareRange, ListedRecord, Member, RangeCompared, Span
from scenefold.world import Priority

ASK_S_MAX = 10.0
_FEW = 2


class Offer(NamedTuple):
    """What somebody says that it has."""

    rank: Rank
    member: Member
    listed: ListedRecord


class Asking:
    """Used from the Trio thread only."""

    def __init__(self, parts: Parts) -> None:
        self._peers = parts.peers

    async def offers(self, spot: Spot, members: Sequence[Member], enough: Rank | None = None) -> tuple[list[Offer], bool]:
        """Of those who answer, asked all at once, the newest first; whether all of them did.

        `enough`: with the first offer of that rank or a higher one nobody else is waited for. Else who says nothing would cost each record its time.
        """
        offers: list[Offer] = []
        answered = 0

        async def ask(member: Member) -> None:
            nonlocal answered
            with suppress(Refused, Unreachable, PeerFault):
                offer = await self._ask(spot, member)
                answered += 1
                if offer is not None:
                    offers.append(offer)
                    if enough is not None and offer.rank >= enough:
                        nursery.cancel_scope.cancel()

        async with trio.open_nursery() as nursery:
            for member in members:
                nursery.start_soon(ask, member)
        return _newest_first(offers), answered == len(members)

    async def anywhere(self, spot: Spot, members: Sequence[Member]) -> list[Offer]:
        """Likewise, of as many as answer."""
        found, _ = await self.offers(spot, members)
        return found

    async def heard(self, spot: Spot, sources: Sources, debt: Debt | None) -> tuple[list[Offer], bool, Debt | None]:
        """What lay there or newer, of all who have it, the newest first; whether all have answered; and the debt, if only it says what lay there.

        Refused if nobody knows that.
        """
        told: list[Offer | None] = []
        for member in sources.sure:
            with suppress(Refused, Unreachable, PeerFault):
                # Of a sure one that has nothing it has rotted as well.
                told.append(await self._ask(spot, member, must_know=not sources.is_own))
        named = [offer for offer in told if offer is not None]
        if named:
            # Those who are sure may have lost its bytes; whoever else has that version has what lay there.
            others, have_all_answered = await self.offers(spot, [member for member in sources.members if member not in sources.sure])
            least = max(offer.rank for offer in named)
            found = [offer for offer in (*named, *others) if offer.rank >= least]
            return _newest_first(found), have_all_answered and len(told) == len(sources.sure), None
        if debt is not None:
            # Who is owed it may have got it nevertheless. Nobody who has another version has what lay there.
            return *await self.offers(spot, sources.members), debt
        if not told and not sources.all_of:
            raise Refused(RejectReason.NOT_READY, "nobody answers who is sure to have what lay there")
        heard = [await self._ask(spot, member) for member in sources.all_of]
        return _newest_first(offer for offer in heard if offer is not None), True, None

    async def _ask(self, spot: Spot, member: Member, *, must_know: bool = False) -> Offer | None:
        """What a member has there. Refused if it `must_know`, and does not say that it has all."""
        request = CompareRange(spot.place.scene, spot.place.space, (Span(spot.home, spot.home),), _FEW)
        reply = await self._peers.ask(member.node, Priority.LOW, request, RangeCompared, ASK_S_MAX)
        (told,) = reply.sums if len(reply.sums) == 1 else (ArcSum(0, bytes(32), None, whole=False),)
        if told.records is None or (must_know and not told.whole):
            raise Refused(RejectReason.NOT_READY, "who should know does not say what lies there")
        found = next((listed for listed in told.records if listed.object == spot.object), None)
        return None if found is None else Offer(rank_of(found.version), member, found)


def _newest_first(offers: Iterable[Offer]) -> list[Offer]:
    return sorted(offers, key=lambda offer: (offer.rank, offer.member.node), reverse=True)
