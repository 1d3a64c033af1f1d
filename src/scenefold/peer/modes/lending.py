"""Packets 121 of clients: a participant lends them what is left of its own lease; who only looks is heard by any node (specs/26-modes.md, Lent leases)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

from scenefold.base.errors import DamagedData, PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, SceneId
from scenefold.base.reasons import RejectReason
from scenefold.crypto import LEASE_DOMAIN, PublicKey
from scenefold.peer.handlers import Handlers, node_of
from scenefold.peer.modes.lender import Borrower
from scenefold.peer.modes.scene_modes import SceneModes
from scenefold.peer.peers import Peers
from scenefold.peer.records.verification import KnownScene
from scenefold.wire import BorrowLease, LeaseUse, LentLease, Packet, SceneMode
from scenefold.world import Priority, World

LEASE_S_MAX = 2.0
"""For a participant to have a lease of its own, when somebody wants one and it has none yet."""
RELAY_S_MAX = 4.0
MODES: Mapping[LeaseUse, SceneMode] = {LeaseUse.EDIT: SceneMode.EDIT, LeaseUse.RENDER: SceneMode.RENDER}

ModesOf = Callable[[SceneId], SceneModes | None]
"""Those of a scene that this node decides with others; None where it does not."""


class Lending:
    """`here`: what this node knows of a scene."""

    def __init__(self, world: World, peers: Peers, me: NodeId, modes_of: ModesOf, here: Callable[[SceneId], KnownScene | None]) -> None:
        self._world, self._peers, self._me, self._modes_of, self._here = world, peers, me, modes_of, here

    def register(self, handlers: Handlers) -> None:
        handlers.add(BorrowLease, self._on_borrow)

    async def _on_borrow(self, packet: BorrowLease, peer: str) -> Packet:
        known, modes = self._here(packet.scene), self._modes_of(packet.scene)
        if known is None or known.public.genesis != packet.genesis:
            raise Refused(RejectReason.UNKNOWN_SCENE_OR_SPACE, f"scene {packet.scene:08x} is unknown here")
        is_look = packet.use is LeaseUse.LOOK
        if modes is not None and (packet.lender == self._me or (is_look and not packet.lender)):
            return await self._answer(packet, modes, known)
        if not known.public.participants:
            what = "nobody decides the scene but its origin, and no leases are held of it"
            raise Refused(RejectReason.NOT_AUTHORISED, what)
        if not is_look and packet.lender == self._me and self._me in [entry.member.node for entry in known.public.participants]:
            # Started anew, it does not act yet; or it is another incarnation than the one that takes part.
            raise unknown_mode()
        if not is_look:
            # Nobody signs the answer: who heard it from a relay would have to believe that.
            raise Refused(RejectReason.NOT_AUTHORISED, "leases are lent by the participant that is asked for one, and by no other")
        if node_of(peer) is not None:
            raise Refused(RejectReason.NOT_MY_LOCATION, "this node does not decide the scene")
        return await self._relayed(packet, known)

    async def _answer(self, packet: BorrowLease, modes: SceneModes, known: KnownScene) -> LentLease:
        if packet.use is LeaseUse.LOOK:
            if not await modes.leased(LEASE_S_MAX):
                raise unknown_mode()
            return LentLease(packet.nonce, self._me, modes.public.position, modes.public.mode, modes.is_active)
        await self._world.workers.run("crypto", partial(_check_asker, packet, known))
        borrower = Borrower(packet.key, packet.process)
        if packet.use is LeaseUse.GIVE_BACK:
            modes.take_back(borrower, packet.nonce)
            return LentLease(packet.nonce, self._me, modes.public.position, modes.public.mode, modes.is_active)
        await modes.acting(LEASE_S_MAX)
        left_s, is_asked_back = modes.lend(borrower, MODES[packet.use], packet.nonce)
        # Rounded down: never longer than the lender's own.
        return LentLease(packet.nonce, self._me, modes.public.position, modes.public.mode, True, int(left_s * 1000), is_asked_back)

    async def _relayed(self, packet: BorrowLease, known: KnownScene) -> Packet:
        deciders = [entry.member.node for entry in known.public.participants if packet.lender in (NodeId(0), entry.member.node)]
        problem: Refused | Unreachable | PeerFault = Refused(RejectReason.NO_MAJORITY, "no participant of the scene seems alive")
        for node in [other for other in self._peers.others() if other in deciders]:
            try:
                return await self._peers.ask(node, Priority.HIGH, packet, LentLease, RELAY_S_MAX)
            except (Refused, Unreachable, PeerFault) as failure:
                problem = failure
        if isinstance(problem, Refused):
            raise problem
        raise Refused(RejectReason.NOT_READY, "the scene's participants do not answer", remedy="try again in a while") from problem


def unknown_mode() -> Refused:
    what = "the scene's mode is unknown: this participant has no lease, for it cannot reach most of the others, or does not know yet what they decided"
    return Refused(RejectReason.MODE_FORBIDS, what, remedy="try again in a while, or at another participant")


def _check_asker(packet: BorrowLease, known: KnownScene) -> None:
    """Refused unless a writer of the scene has signed it."""
    key: PublicKey | None = known.keys.get(packet.key)
    newest = [term for term in known.writers.get(packet.key, ()) if term.until_position >= known.public.position]
    if key is None or not newest:
        raise Refused(RejectReason.NOT_AUTHORISED, f"key {packet.key:08x} is no writer of the scene")
    try:
        key.verify(packet.signature, LEASE_DOMAIN, packet.signable())
    except DamagedData as problem:
        raise Refused(RejectReason.SIGNATURE_INVALID, "the key that asks has not signed that") from problem
