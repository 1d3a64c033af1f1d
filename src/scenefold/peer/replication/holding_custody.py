"""What a holder is told to hold, and what it says of what it has: SetCustody, ListHeld (specs/20-copies.md, Custody, Recovery).

Both change custody durably before they are answered. So nothing that this node has confirmed or promised is forgotten by a crash.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from scenefold.base.errors import Refused
from scenefold.base.limits import CUSTODY_ENTRIES_MAX
from scenefold.base.location import Arc
from scenefold.base.reasons import RejectReason
from scenefold.peer.copies.copies import Copies
from scenefold.peer.copies.custody import Behind
from scenefold.peer.copies.entries import Entry
from scenefold.peer.copies.numbers import first_number, is_possible
from scenefold.peer.copies.telling import entry_of, told_entry
from scenefold.peer.copies.versions import told_version
from scenefold.peer.handlers import Handlers, Senders
from scenefold.peer.line.holding import Holding
from scenefold.peer.line.parts import Parts
from scenefold.peer.membership.roster import Roster
from scenefold.peer.replication.holding_rules import require_let_go, require_meant, require_none_own, require_owner, require_sender
from scenefold.store import Held
from scenefold.store.held import HeldPage
from scenefold.wire import CustodySet, HeldListed, HeldRecord, ListHeld, Packet, SceneTurn, SetCustody

_TEXT_MAX = 256
_ENTRIES = bytes(6)
"""A cursor among entries begins so: behind no record, and before all, since these begin with a scene and a space."""
_INDEX_BYTES = 4


class HoldingCustody:
    """Used from the Trio thread only."""

    def __init__(self, parts: Parts, roster: Roster) -> None:
        self._parts = parts
        self._roster = roster

    def register(self, handlers: Handlers) -> None:
        handlers.add(SetCustody, self._on_set, senders=Senders.NODES)
        handlers.add(ListHeld, self._on_list, senders=Senders.NODES)

    # ------------------------------------------------------------------------------------------------- SetCustody

    async def _on_set(self, packet: SetCustody, peer: str) -> Packet:
        try:
            await self._set(packet, peer)
        except Refused as refusal:
            highest = refusal.highest if isinstance(refusal, Behind) else 0
            return CustodySet(int(refusal.reason), highest, str(refusal)[:_TEXT_MAX])
        return CustodySet(0, packet.number, "")

    async def _set(self, packet: SetCustody, peer: str) -> None:
        parts, scope = self._parts, Arc(packet.first, packet.last)
        require_sender(peer, packet.owner)
        require_meant(parts, packet.holder)
        parts.arrival.require()
        await require_owner(parts, self._roster, packet.owner, scope)
        await require_let_go(parts, self._roster, packet.owner, scope)
        await self._check_number(packet)
        if any(entry.whole and parts.own.member not in entry.members for entry in packet.entries):
            raise Refused(RejectReason.ILL_FORMED, "a whole copy is held by a member of its configuration")
        entries = tuple(map(entry_of, packet.entries))

        def told(copies: Copies, holding: Holding) -> Copies:
            require_none_own(holding.arc, scope)
            custody = copies.custody.set(packet.owner, packet.number, scope, entries)
            if sum(entry.owner == packet.owner for entry in custody.entries) > CUSTODY_ENTRIES_MAX:
                raise Refused(RejectReason.LIMIT_EXCEEDED, f"{CUSTODY_ENTRIES_MAX} pieces are held for one owner, and no more")
            return copies if custody is copies.custody else replace(copies, custody=custody)

        await parts.keeper.change_copies(told)
        parts.events["custody set"] += 1

    async def _check_number(self, packet: SetCustody) -> None:
        """Refused (5) for a number that no honest owner can have come to: nobody after it could go on above."""
        log = self._parts.cluster_log
        if not is_possible(packet.number, log.registry.position):
            await log.pull_from(packet.owner.node)
        if not is_possible(packet.number, log.registry.position):
            raise Refused(RejectReason.ILL_FORMED, "no owner can have come to such a number of configurations")

    # --------------------------------------------------------------------------------------------------- ListHeld

    async def _on_list(self, packet: ListHeld, peer: str) -> Packet:
        try:
            return await self._list(packet, peer)
        except Refused as refusal:
            return HeldListed(int(refusal.reason), (), (), None)

    async def _list(self, packet: ListHeld, peer: str) -> HeldListed:
        parts, arc = self._parts, Arc(packet.first, packet.last)
        require_sender(peer, packet.asker)
        require_meant(parts, packet.holder)
        parts.arrival.require()
        if not packet.log_position:
            raise Refused(RejectReason.ILL_FORMED, "nothing is adopted before the cluster's log begins")
        if parts.cluster_log.registry.position < packet.log_position:
            await parts.cluster_log.pull_from(packet.asker.node)
        if parts.cluster_log.registry.position < packet.log_position:
            raise Refused(RejectReason.POSITION_BEHIND, "the cluster's log is not known here so far")
        await require_owner(parts, self._roster, packet.asker, arc)

        def promised(copies: Copies, holding: Holding) -> Copies:
            require_none_own(holding.arc, arc)
            custody = copies.custody.promise(arc, first_number(packet.log_position))
            return copies if custody == copies.custody else replace(copies, custody=custody)

        # With every page: what is said of the later ones is a promise as well, also if this node was started anew in between.
        custody = (await parts.keeper.change_copies(promised)).custody
        entries, after = _entries_behind(packet.after, custody.within(arc))
        turns = () if packet.after else tuple(SceneTurn(*turn) for turn in sorted(parts.knowing.view().items()))
        # Only now: what is stored here from now on is taken under numbers above the promise.
        page = HeldPage([], after) if after is not None else await parts.store.held(arc, _records_behind(packet.after), packet.limit)
        return HeldListed(0, tuple(map(_told, page.records)), tuple(map(told_entry, entries)), page.cursor, turns)


def _entries_behind(after: bytes, entries: Sequence[Entry]) -> tuple[Sequence[Entry], bytes | None]:
    """Those of one page, and the cursor of the next page of entries. They stay as they are: whoever might change them waits for the asker."""
    if after and not _is_of_entries(after):
        return (), None
    first = int.from_bytes(after[len(_ENTRIES) :], "big")
    last = first + CUSTODY_ENTRIES_MAX
    return entries[first:last], _ENTRIES + last.to_bytes(_INDEX_BYTES, "big") if last < len(entries) else None


def _records_behind(after: bytes) -> bytes:
    """Records come with the last of the entries."""
    return b"" if _is_of_entries(after) else after


def _is_of_entries(after: bytes) -> bool:
    return after.startswith(_ENTRIES) and len(after) == len(_ENTRIES) + _INDEX_BYTES


def _told(held: Held) -> HeldRecord:
    place = held.spot.place
    return HeldRecord(place.scene, place.space, place.location, held.spot.object, told_version(held.header))
