"""Whoever may answer by an old header is asked for it, and shown the new one, until it has that (specs/23-turns.md, Who knows)."""

from __future__ import annotations

import logging
from collections.abc import Iterable

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import SceneId, address_of
from scenefold.base.reasons import RejectReason
from scenefold.peer.line.parts import Parts
from scenefold.peer.line.pauses import Pauses
from scenefold.peer.membership.roster import Roster
from scenefold.peer.replication.telling_words import members_of
from scenefold.peer.scene_log.proposals import answer_of
from scenefold.peer.scene_log.scene_asking import ASK_S_MAX, said_by
from scenefold.scene.log.values import deciding
from scenefold.wire import Member, RespondSceneLog, SceneTurn
from scenefold.world import Priority

LOOK_S = 1.0
"""Between two looks at who is to be asked."""
ASKED_MAX = 16
"""At one time."""
AGAIN_S = 0.1
"""After a header was shown, before it is asked whether it was taken."""
_NEVER_HONEST = (RejectReason.ILL_FORMED, RejectReason.SIGNATURE_INVALID, RejectReason.NOT_AUTHORISED, RejectReason.POSITION_TAKEN)

_log = logging.getLogger("scenefold.peer.replication")


class Teaching:
    """Used from the Trio thread only."""

    def __init__(self, parts: Parts, roster: Roster) -> None:
        self._parts = parts
        self._roster = roster
        self._slots = trio.CapacityLimiter(ASKED_MAX)
        self._working: set[Member] = set()
        parts.knowing.view = self.view
        parts.knowing.teach = self.teach
        parts.knowing.learn = self.learn

    def view(self) -> dict[SceneId, int]:
        """Of each scene with a space that has turned, where the last one did."""
        return {known.public.scene: known.turned for known in self._parts.scenes.everyone() if known.turns}

    async def run(self) -> None:
        """Ask all who have to know, until cancelled."""
        parts = self._parts
        async with trio.open_nursery() as nursery:
            while True:
                seen = parts.keeper.copies
                for member in self._pupils():
                    if member not in self._working and not parts.knowing.knows_all(member) and self._is_there(member):
                        self._working.add(member)
                        nursery.start_soon(self._work, member)
                with trio.move_on_after(LOOK_S):
                    await parts.keeper.copies_changed_after(seen)

    def _pupils(self) -> list[Member]:
        """Who holds copies here, or did; and, of the scenes that this node decides, everybody."""
        parts = self._parts
        if not self.view():
            return []
        found = dict.fromkeys(members_of(parts.keeper.copies.configurations))
        if any(known.turns and parts.own.me in deciding(known.public) for known in parts.scenes.everyone()):
            registry = parts.cluster_log.registry
            known_members = [known.member for node in registry.members if (known := registry.current(node)) is not None]
            found.update(dict.fromkeys(known_members))
        return [member for member in found if member != parts.own.member]

    def _is_there(self, member: Member) -> bool:
        return self._roster.is_believed_alive(member.node) and not self._parts.keeper.is_removed(member)

    async def _work(self, member: Member) -> None:
        pauses = Pauses(self._parts.world)
        try:
            while self._is_there(member) and not self._parts.knowing.knows_all(member):
                try:
                    async with self._slots:
                        await self.teach(member)
                except (Refused, Unreachable, PeerFault) as problem:
                    _log.debug("%s may not know yet which spaces have other copies now: %s", address_of(member.node), problem)
                    await pauses.wait()
        finally:
            self._working.discard(member)

    # -------------------------------------------------------------------------------------------------------- doing

    async def teach(self, member: Member) -> None:
        """Return when it has shown that it knows all that this node knew when it was called. Refused, Unreachable or PeerFault: not now."""
        for scene, position in self.view().items():
            if not self._parts.knowing.knows(member, scene, position) and not await self._has_shown(member, scene, position):
                await self._show(member, scene)
                await self._parts.world.clock.sleep(AGAIN_S)
                if not await self._has_shown(member, scene, position):
                    raise Refused(RejectReason.NOT_READY, f"{address_of(member.node)} has not taken a header yet")

    async def _has_shown(self, member: Member, scene: SceneId, position: int) -> bool:
        parts = self._parts
        is_meant = parts.cluster_log.registry.is_current(member)
        public = await said_by(parts.peers, member.node, scene)
        # Who answers may be another incarnation, unless the log knows this one before and after.
        if not (is_meant and parts.cluster_log.registry.is_current(member)):
            raise Refused(RejectReason.WRONG_INCARNATION, f"{address_of(member.node)} is another one by now")
        if public is None or public.position < position:
            return False
        here = parts.scenes.here(scene)
        if here is not None and public.genesis != here.public.genesis:
            raise PeerFault("shows the header of another scene", where=address_of(member.node))
        parts.knowing.note(member, scene, position)
        return True

    async def _show(self, member: Member, scene: SceneId) -> None:
        known = self._parts.scenes.here(scene)
        if known is not None:
            packet = RespondSceneLog(answer=answer_of(known.public, 0, None))
            await self._parts.peers.tell(member.node, Priority.HIGH, packet, ASK_S_MAX)

    # ----------------------------------------------------------------------------------------------------- learning

    async def learn(self, teller: Member, turns: Iterable[SceneTurn]) -> None:
        """Return when this node knows these turns, too. Refused or Unreachable: not now; PeerFault: they cannot be."""
        for turn in turns:
            if self._lacks(turn):
                public = await said_by(self._parts.peers, teller.node, turn.scene)
                if public is None or public.position < turn.position:
                    raise PeerFault("names a header that it does not show", where=address_of(teller.node))
                try:
                    await self._parts.scenes.adopt(public)
                except Refused as refusal:
                    if self._lacks(turn) and refusal.reason in _NEVER_HONEST:
                        raise PeerFault(f"shows a header that cannot be: {refusal}", where=address_of(teller.node)) from refusal
                    if self._lacks(turn):
                        raise

    def _lacks(self, turn: SceneTurn) -> bool:
        known = self._parts.scenes.here(turn.scene)
        return known is None or known.public.position < turn.position
