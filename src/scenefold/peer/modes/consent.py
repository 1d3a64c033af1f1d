"""Whom a change of a scene's mode needs beside those who decide: observers that seem alive (specs/26-modes.md, The switch).

Participants say in PREPARE whether it suits them. Observers get no such packets, so whichever participant proposes the change asks them before.
"""

from __future__ import annotations

import logging
from typing import Protocol

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.base.reasons import RejectReason
from scenefold.peer.peers import Peers
from scenefold.wire import Member, RejectSceneProposal, RequestSceneLog, RespondSceneLog, SceneLogPublic, Want
from scenefold.world import Priority, World

CONSENT_S_MAX = 2.0
"""For an observer to answer."""
CONSENT_TRIES = 2
_SILENT_MS_MAX = (1 << 32) - 1

_log = logging.getLogger("scenefold.peer.modes")


class Around(Protocol):
    """The world as this node sees it now."""

    def alive(self) -> frozenset[NodeId]: ...
    def is_gone(self, member: Member, /) -> bool: ...
    def silent_s(self, node: NodeId, /) -> float | None: ...


class Consent:
    """At a participant."""

    def __init__(self, world: World, peers: Peers, around: Around) -> None:
        self._world, self._peers, self._around = world, peers, around

    def missing(self, node: NodeId) -> RejectSceneProposal:
        """120 (3): this one seems alive, and does not answer."""
        silent_s = self._around.silent_s(node) or 0.0
        return RejectSceneProposal(RejectReason.PEER_MISSED, node, min(int(silent_s * 1000), _SILENT_MS_MAX))

    async def lacking(self, public: SceneLogPublic) -> RejectSceneProposal | None:
        """Why the scene must not leave the mode that this header shows, and by whom; None if no observer has anything against it.

        Who does not answer is passed over, if meanwhile nothing else was heard of it either.
        """
        around, began = self._around, self._world.clock.now()
        alive = around.alive()
        silent = {entry.member.node for entry in public.observers if entry.member.node in alive and not around.is_gone(entry.member)}
        against: set[NodeId] = set()
        for _ in range(CONSENT_TRIES):
            async with trio.open_nursery() as nursery:
                for node in sorted(silent):
                    nursery.start_soon(self._ask, node, public, silent, against)
        if against:
            return RejectSceneProposal(RejectReason.BUSY, min(against))
        asked_s = self._world.clock.now() - began
        for node in sorted(silent):
            silent_s = around.silent_s(node)
            if silent_s is not None and silent_s < asked_s:
                return self.missing(node)
        return None

    async def _ask(self, node: NodeId, public: SceneLogPublic, silent: set[NodeId], against: set[NodeId]) -> None:
        packet = RequestSceneLog(public.scene, public.genesis, public.position, 0, Want.CONSENT)
        try:
            await self._peers.ask(node, Priority.HIGH, packet, RespondSceneLog, CONSENT_S_MAX)
        except Refused as refusal:
            # Whoever does not know of it, or observes no more, uses nothing.
            if refusal.reason is RejectReason.BUSY:
                against.add(node)
        except (Unreachable, PeerFault) as problem:
            _log.debug("scene %08x: observer %s does not say whether the mode may change: %s", public.scene, address_of(node), problem)
            return
        silent.discard(node)
