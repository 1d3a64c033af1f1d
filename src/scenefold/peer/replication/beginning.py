"""What a node finds that it owes when it starts: what that leaves unsettled is sent first (specs/20-copies.md, Writes).

Nobody knows whether a write of before the start was acknowledged. Where so many are still to get it that it cannot have been,
nobody is told of it before they have it.
"""

from __future__ import annotations

from scenefold.base.errors import Refused
from scenefold.base.limits import CIPHERTEXT_BYTES_MAX
from scenefold.peer.line.parts import Parts
from scenefold.peer.line.unsettled import Pending, name_of
from scenefold.peer.replication.judging import Judging
from scenefold.store.debts import Debt

PAGE = 256
PENDING_MAX = 16_384
"""Of before the start, at a time. The rest is looked at once these are settled, and until then anything may be unsettled."""
PAUSE_S = 1.0


class Beginning:
    """Used from the Trio thread only."""

    def __init__(self, parts: Parts, judging: Judging) -> None:
        self._parts = parts
        self._judging = judging
        self._unsettled = parts.unsettled

    def begin(self) -> None:
        """Doubt what cannot be told yet. Before anybody can ask, and after the line has loaded what it kept."""
        self._unsettled.is_read = not self._parts.store.owed
        self._judging.doubt_unsafe()

    async def run(self) -> None:
        """Look through all that was owed, once."""
        cursor: bytes | None = None
        while not self._unsettled.is_read:
            page = await self._parts.store.debts(cursor, PAGE)
            for debt in page.debts:
                await self._look_at(debt)
            while len(self._unsettled) > PENDING_MAX:
                await self._parts.world.clock.sleep(PAUSE_S)
            cursor = page.after
            if cursor is None:
                self._unsettled.read_all()
        for node in self._parts.store.owed:
            self._judging.owes(node)

    async def _look_at(self, debt: Debt) -> None:
        scene, space, _ = debt.spot.place
        if not self._parts.keeper.holding.owns(debt.spot.home):
            return
        try:
            known = await self._parts.scenes.known(scene, ask=False)
        except Refused:
            # Of an unknown scene nobody is told anything.
            return
        layout = known.layouts.get(space, ())
        if not layout or any(pending.version == debt.version for pending in self._unsettled.of(name_of(debt.spot))):
            return
        needed, me = known.needed[space], self._parts.own.member
        pending = Pending.of_stored(debt.spot, debt.version, layout, needed, debt.nodes, me, CIPHERTEXT_BYTES_MAX)
        rule = self._judging.rule_at(layout, debt.spot)
        if rule is None or not self._judging.is_settled(pending, rule):
            # Whatever else is pending there was given to the store since.
            self._unsettled.add(pending, is_oldest=True)
            self._judging.send(pending)
