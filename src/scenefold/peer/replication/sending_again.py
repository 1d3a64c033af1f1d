"""What is read in a doubted part of the arc settles by itself, before all of that does (specs/20-copies.md, Recovery).

After an adoption nobody knows who has what there, and until all holders were compared all of it is doubted. What somebody reads meanwhile is
sent to its holders once more, like what a client writes again: it may be told once enough of them have said that they have it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from scenefold.base.ids import SceneId, SpaceId
from scenefold.base.limits import CIPHERTEXT_BYTES_MAX
from scenefold.base.location import Arc
from scenefold.base.placement import Layout
from scenefold.crypto import Record
from scenefold.peer.line.parts import Parts
from scenefold.peer.line.unsettled import Pending, name_of
from scenefold.peer.replication.judging import Judging
from scenefold.store import Spot
from scenefold.store.versions import version_of

SENT_MAX = 256
"""So many are on their way at a time, whoever reads; the rest waits for the whole part."""

Place = tuple[SceneId, SpaceId, Arc]


class SendingAgain:
    """Used from the Trio thread only."""

    def __init__(self, parts: Parts, judging: Judging) -> None:
        self._parts = parts
        self._judging = judging
        self._sent: set[Pending] = set()

    async def send(self, here: Sequence[tuple[Spot, Record]]) -> Mapping[Place, Pending | None]:
        """Of these records, which were just read, what is doubted and can be sent, by place; None if it is settled as it is.

        As it was read, that is: what is there by now has come since, and is pending.
        """
        found: dict[Place, Pending | None] = {}
        doubted = [(spot, record) for spot, record in here if self._layout_of(spot)]
        if not doubted:
            return found
        owed = await self._parts.store.debtors_of([spot for spot, _ in doubted])
        self._sent = {pending for pending in self._sent if not pending.is_settled}
        for (spot, record), debtors in zip(doubted, owed, strict=True):
            # Once more: it may have been given away since, or have come to another layout. What is doubted still is given to nobody.
            layout = self._layout_of(spot)
            if not layout:
                continue
            version = version_of(record.header_bytes)
            # What is not stored may be dropped, as it is here already: that says nothing of who has it.
            same = next((one for one in self._parts.unsettled.of(name_of(spot)) if one.version == version and one.is_stored), None)
            if same is not None:
                found[place_of(spot)] = same
                continue
            known = self._parts.scenes.here(spot.place.scene)
            assert known is not None  # or there was no layout
            needed, size = known.needed[spot.place.space], len(record.ciphertext) or CIPHERTEXT_BYTES_MAX
            pending = Pending.of_stored(spot, version, layout, needed, debtors, self._parts.own.member, size)
            rule = self._judging.rule_at(layout, spot)
            if rule is not None and self._judging.is_settled(pending, rule):
                found[place_of(spot)] = None
            elif len(self._sent) < SENT_MAX:
                # Whatever else is pending there was given to the store since.
                self._parts.unsettled.add(pending, is_oldest=True)
                self._judging.send(pending)
                self._sent.add(pending)
                found[place_of(spot)] = pending
        return found

    def _layout_of(self, spot: Spot) -> Layout:
        """() if it is not doubted, or cannot be sent to anybody now."""
        layout, there = self._judging.layout_of(*spot.place[:2]), Arc(spot.home, spot.home)
        if not layout or not self._parts.unsettled.is_doubted(layout, there) or not self._parts.keeper.copies.is_recovered(there):
            return ()
        return layout


def place_of(spot: Spot) -> Place:
    """Where somebody looks for it."""
    return (*spot.place[:2], Arc(spot.home, spot.home))
