"""A node's own lease of a scene, asked of all who decide its next position (specs/26-modes.md, Leases)."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import TYPE_CHECKING

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId
from scenefold.crypto import LEASE_DOMAIN
from scenefold.peer.membership.status import OwnStatus
from scenefold.peer.modes.packets import lease_message
from scenefold.peer.peers import Peers
from scenefold.peer.timing import LEASE_ASK_S_MAX, LEASE_RETRY_S, RENEW_S
from scenefold.wire import RequestSceneLog, RespondSceneLog, Want
from scenefold.world import Priority, World
from scenefold.world.waking import sleep_until

if TYPE_CHECKING:
    from scenefold.peer.modes.scene_modes import SceneModes

GRANT = 1
WANTED_S = 30.0
"""So long leases are asked for behind the last time that somebody wanted one."""

_log = logging.getLogger("scenefold.peer.modes")


class Asking:
    """`behind` is called when somebody knows more of the log than this node."""

    def __init__(self, modes: SceneModes, world: World, peers: Peers, own: OwnStatus, behind: Callable[[], object]) -> None:
        self._modes, self._world, self._peers, self._own, self._behind = modes, world, peers, own, behind
        self._wanted_until = -1.0

    def wants(self) -> None:
        """Somebody wants to act by a lease."""
        self._wanted_until = self._world.clock.now() + WANTED_S
        self._modes.news.tell()

    def forget(self) -> None:
        self._wanted_until = -1.0

    async def run(self) -> None:
        """Until cancelled."""
        modes, clock = self._modes, self._world.clock
        while True:
            await modes.news.until(lambda: clock.now() < self._wanted_until and modes.standing.may_ask)
            asked_at = clock.now()
            await self._ask()
            lease = modes.standing.holder.held
            is_new = lease is not None and modes.standing.holder.lease(asked_at) is not None
            pause = RENEW_S if is_new else LEASE_RETRY_S
            await sleep_until(clock, asked_at + pause)

    async def _ask(self) -> None:
        modes, member = self._modes, self._own.member
        nonce = int.from_bytes(self._world.entropy.token(8), "big")
        modes.standing = modes.standing.asks(nonce, self._world.clock.now())
        public = modes.public
        plain = RequestSceneLog(public.scene, public.genesis, public.position, nonce, Want.LEASE, member)
        proof = self._own.key.sign(LEASE_DOMAIN, lease_message(plain, member))
        packet = RequestSceneLog(public.scene, public.genesis, public.position, nonce, Want.LEASE, member, proof)
        async with trio.open_nursery() as nursery:
            for node in modes.standing.scene.deciders - {member.node}:
                nursery.start_soon(self._ask_one, node, packet)
        modes.news.tell()

    async def _ask_one(self, node: NodeId, packet: RequestSceneLog) -> None:
        modes = self._modes
        try:
            answer = (await self._peers.ask(node, Priority.HIGH, packet, RespondSceneLog, LEASE_ASK_S_MAX)).answer
        except (Refused, Unreachable, PeerFault) as problem:
            _log.debug("no lease of scene %08x from node %s: %s", packet.scene, node, problem)
            return
        if answer is None or answer.nonce != packet.nonce:
            return
        if answer.flags & GRANT:
            modes.standing = modes.standing.granted(packet.nonce, node)
            modes.news.tell()
        if answer.position > modes.public.position:
            self._behind()
