"""What may have been lost is kept, told to all other nodes, and shown until an administrator has seen it (specs/20-copies.md, What is lost).

Told, so that it is known as long as any of them is: who notes it may be the next one to die, or to be drained.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import pairwise
from typing import Any

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import address_of, is_machine
from scenefold.base.location import LINE_LENGTH
from scenefold.base.reasons import RejectReason
from scenefold.peer.copies.losses import Loss
from scenefold.peer.copies.losses_note import NOTE, Losses, decode_losses, encode_losses, id_of
from scenefold.peer.handlers import Handlers, Senders, node_of
from scenefold.peer.line.parts import Parts
from scenefold.wire import AcknowledgeLosses, LossesKept, Member, NotedLoss, TellLosses
from scenefold.wire.copy_packets import Span
from scenefold.world import Priority, first_of

TELL_AGAIN_S = 10.0
"""Between two tries to tell who has not heard of all that this node has noted."""
TELL_S_MAX = 5.0
"""Until one that does not answer is passed over."""

_log = logging.getLogger("scenefold.peer.replication")


class Noting:
    """`register`, then `load`, then `run`. Used from the Trio thread only."""

    def __init__(self, parts: Parts, *, may_order: Callable[[str], bool] = lambda _user: True) -> None:
        """`may_order`: whether a user may acknowledge anything."""
        self._parts = parts
        self._may_order = may_order
        self._losses = Losses()
        self._lock = trio.Lock()
        self._changed = trio.Event()

    def register(self, handlers: Handlers) -> None:
        handlers.add(TellLosses, self._on_told, senders=Senders.NODES)
        handlers.add(AcknowledgeLosses, self._on_acknowledged, senders=Senders.USERS)

    async def load(self) -> None:
        """What was kept in an earlier life. DamagedData if that cannot be read."""
        note = await self._parts.store.get_note(NOTE)
        if note is not None:
            self._losses = decode_losses(note)

    @property
    def kept(self) -> Sequence[NotedLoss]:
        """What nobody has acknowledged yet."""
        return self._losses.kept

    async def note(self, losses: Sequence[Loss]) -> None:
        """Keep these durably, and have all others keep them. Refused if that cannot be."""
        me, now_ms = self._parts.own.me, max(0, round(self._parts.world.clock.wall() * 1000))
        noted = [
            NotedLoss(me, now_ms, loss.copies, loss.is_left, loss.removed, tuple(Span(arc.first, arc.last) for arc in loss.arcs))
            for loss in losses
        ]
        await self._change(lambda kept: kept.add(*noted))

    async def run(self) -> None:
        """Tell the others what this node has noted, each until it has confirmed that, until cancelled."""
        told: set[tuple[Member, bytes]] = set()
        while True:
            changed, registry = self._changed, self._parts.cluster_log.registry
            own = {id_of(loss): loss for loss in self.kept if loss.noted_by == self._parts.own.me}
            others = [Member(node, found.incarnation) for node in registry.members if (found := registry.current(node)) is not None]
            told &= {(member, name) for member in others for name in own}
            async with trio.open_nursery() as nursery:
                # All at once: those who do not answer keep nobody waiting.
                for member in others:
                    new = [name for name in own if (member, name) not in told]
                    if new and member != self._parts.own.member:
                        nursery.start_soon(self._tell, member, {name: own[name] for name in new}, told)
            waiting = any((member, name) not in told for member in others for name in own if member != self._parts.own.member)
            pause = partial(self._parts.world.clock.sleep, TELL_AGAIN_S) if waiting else trio.sleep_forever
            # Who has joined since is told as well.
            await first_of(pause, changed.wait, partial(self._parts.cluster_log.changed_after, registry.position))

    def documents(self) -> list[dict[str, Any]]:
        """The part of the report that speaks of it."""
        return [_document(loss) for loss in self.kept]

    # --------------------------------------------------------------------------------------------------- helpers

    async def _tell(self, member: Member, losses: Mapping[bytes, NotedLoss], told: set[tuple[Member, bytes]]) -> None:
        try:
            await self._parts.peers.ask(member.node, Priority.LOW, TellLosses(tuple(losses.values())), LossesKept, TELL_S_MAX)
        except (Refused, Unreachable, PeerFault) as problem:
            _log.debug("%s does not hear what may be lost: %s", address_of(member.node), problem)
            return
        told.update((member, name) for name in losses)

    async def _on_told(self, packet: TellLosses, peer: str) -> LossesKept:
        if any(loss.noted_by != node_of(peer) for loss in packet.losses):
            raise Refused(RejectReason.NOT_AUTHORISED, f"{peer} tells what it has not noted itself")
        if not all(map(_makes_sense, packet.losses)):
            # It would be in our own report, which nobody could read any more, and for as long as nobody acknowledges what he cannot read.
            raise Refused(
                RejectReason.ILL_FORMED, f"{peer} tells of a loss with no node's address, or with arcs that are not in order and apart"
            )
        await self._change(lambda kept: kept.add(*packet.losses))
        return LossesKept(self._losses.ids)

    async def _on_acknowledged(self, packet: AcknowledgeLosses, peer: str) -> LossesKept:
        if not self._may_order(peer):
            raise Refused(RejectReason.NOT_AUTHORISED, f"{peer} is no administrator of this cluster", remedy="ask one who is")
        await self._change(lambda kept: kept.acknowledge(packet.ids))
        _log.info("%s has seen what may be lost, %d in all", peer, len(packet.ids))
        return LossesKept(self._losses.ids)

    async def _change(self, change: Callable[[Losses], Losses]) -> None:
        async with self._lock:
            after = change(self._losses)
            if after is self._losses:
                return
            await self._parts.store.put_note(NOTE, encode_losses(after))
            self._losses = after
            self._changed.set()
            self._changed = trio.Event()


def _makes_sense(loss: NotedLoss) -> bool:
    """Whether it may be shown: each removed one was a machine, and no part of the line counts twice."""
    apart = all(left.last < right.first for left, right in pairwise(loss.arcs))
    return apart and all(is_machine(member.node) for member in loss.removed)


def _document(loss: NotedLoss) -> dict[str, Any]:
    return {
        "id": id_of(loss).hex(),
        "noted_by": address_of(loss.noted_by),
        "noted_s": loss.noted_ms / 1000,
        "copies": loss.copies,
        "complete_copy_left": loss.is_left,
        "share": sum(span.arc.length for span in loss.arcs) / LINE_LENGTH,
        "removed": [address_of(member.node) for member in loss.removed],
    }
