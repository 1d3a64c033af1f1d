"""What a lying node says of who is where, and of how far a scene is: statuses, tables, headers (specs/17-simulation.md, Lies).

It signs what it likes with its own key, in its own name and in others'. In its own name it may claim what it likes: others go and
ask, and are sent on. All else must be refused: the observer looks for it in what nodes and clients believe.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterable
from dataclasses import replace

from scenefold.base.ids import NodeId, SceneId, address_of
from scenefold.base.location import LAST, LINE_LENGTH, Location
from scenefold.crypto import HEADER_DOMAIN, STATUS_DOMAIN
from scenefold.peer import NodeContext
from scenefold.peer.datagrams import PACKET_BYTES_MAX
from scenefold.scene.log import decided
from scenefold.simulation.liar import Liar, Scope
from scenefold.simulation.lies import TABLE, Manner, of_header
from scenefold.simulation.lying_answers import Honest, overlay
from scenefold.wire import (
    MiniStatus,
    Packet,
    PingBroadcast,
    RequestSceneLog,
    RequestTable,
    RespondSceneLog,
    RespondTable,
    SceneLogAnswer,
    SceneLogPublic,
    Status,
    decode_packet,
    encode_packet,
)

FAR = 1_000
"""Positions by which a header is made up to be ahead: none gets there in a run."""
HEADERS_KEPT = 8


class LyingWords:
    """Of one liar."""

    def __init__(self, liar: Liar) -> None:
        self._liar = liar
        self._slot = liar.node.slot
        self._headers: OrderedDict[SceneId, list[SceneLogPublic]] = OrderedDict()

    def possess(self, context: NodeContext) -> None:
        """Speak for one life of the node."""
        overlay(context, RequestTable, self._table)
        overlay(context, RequestSceneLog, self._header)
        self._context = context
        handlers, datagrams = context.handlers, context.gossip._datagrams
        own_mini, send = handlers._own_mini, datagrams.send

        def mini() -> MiniStatus:
            honest = own_mini()
            return self._mini(honest) if self._liar.chance(Scope.TABLES) else honest

        async def say(packet: bytes, target: NodeId) -> None:
            await send(self._gossip(packet) if self._liar.chance(Scope.STATUSES) else packet, target)

        handlers._own_mini = mini
        datagrams.send = say  # type: ignore[method-assign]

    # ---------------------------------------------------------------------------------------------------- statuses

    def _gossip(self, data: bytes) -> bytes:
        packet = decode_packet(data)
        if not isinstance(packet, PingBroadcast):
            return data
        first, *others = packet.statuses
        self._liar.lies.told["statuses"] += 1
        match self._liar.dice.randrange(4):
            case 0 | 1:
                first = self._signed(self._wide(first))
            case 2 if others:
                others[0] = self._made_up(others[0])
            case _:
                known = self._context.roster.statuses()
                others = [self._made_up(self._liar.dice.choice(known))] if known else others
        told = encode_packet(replace(packet, statuses=(first, *others)))
        return told if len(told) <= PACKET_BYTES_MAX else data

    def _wide(self, status: Status) -> Status:
        """Claims more than it owns."""
        if status.right_bound is None:
            return replace(status, left_fence=None, right_bound=LAST)
        return replace(status, left_fence=None) if self._liar.dice.random() < 0.5 else replace(status, right_bound=LAST)

    def _made_up(self, status: Status) -> Status:
        """In another's name: what it never said, or never signed."""
        changed = replace(
            status, lamport=status.lamport + 1 + self._liar.dice.randrange(1_000), left_fence=None, right_bound=self._anywhere()
        )
        if self._liar.dice.random() < 0.5:
            changed = self._signed(changed)
        return self._liar.made_up.add_status(changed, self._slot)

    def _signed(self, status: Status) -> Status:
        return replace(status, signature=self._liar.key.sign(STATUS_DOMAIN, status.signable()))

    def _anywhere(self) -> Location:
        return Location.from_number(self._liar.dice.randrange(LINE_LENGTH))

    # ------------------------------------------------------------------------------------------------------ tables

    def _mini(self, honest: MiniStatus) -> MiniStatus:
        self._liar.lies.told["statuses"] += 1
        others = [node for node in self._context.routing.members if node != honest.node]
        if not others or self._liar.dice.random() < 0.3:
            return replace(honest, right_bound=self._anywhere())
        return replace(honest, node=self._liar.dice.choice(others), lamport=(1 << 63) - 1, right_bound=self._anywhere())

    async def _table(self, honest: Honest, packet: Packet, peer: str) -> Packet | None:
        answer = await honest(packet, peer)
        if not isinstance(answer, RespondTable) or not answer.statuses or not self._liar.chance(Scope.TABLES):
            return answer
        self._liar.tells(peer, TABLE, Manner.NONSENSE, b"")
        return replace(answer, statuses=tuple(self._wrong_table(answer.statuses)))

    def _wrong_table(self, statuses: tuple[Status, ...]) -> Iterable[Status]:
        dice, me = self._liar.dice, self._context.me
        match dice.randrange(3):
            case 0:
                # Everybody where somebody else is.
                turned = [*statuses[1:], statuses[0]]
                made = [
                    replace(one, left_fence=other.left_fence, right_bound=other.right_bound)
                    for one, other in zip(statuses, turned, strict=True)
                ]
            case 1:
                # All is ours.
                made = [replace(one, left_fence=None, right_bound=LAST if one.node == me else None) for one in statuses]
            case _:
                # Nobody but nodes that there are not.
                names = [NodeId(dice.randrange(0x0A636300, 0x0A6363FF)) for _ in statuses]
                made = [replace(one, node=name, address=address_of(name)) for one, name in zip(statuses, names, strict=True)]
        for status in made:
            if status not in statuses and status.node != me:
                self._liar.made_up.add_status(status, self._slot)
        return made

    # ----------------------------------------------------------------------------------------------------- headers

    async def _header(self, honest: Honest, packet: Packet, peer: str) -> Packet | None:
        answer = await honest(packet, peer)
        if not isinstance(answer, RespondSceneLog) or answer.answer is None or not self._liar.lies_in(Scope.HEADERS):
            return answer
        public = answer.answer.public
        known = self._headers.setdefault(public.scene, [])
        if public not in known:
            known.append(public)
            del known[:-HEADERS_KEPT]
        if not self._liar.chance(Scope.HEADERS):
            return answer
        self._liar.tells(peer, of_header(public.scene), Manner.NONSENSE, b"")
        return replace(answer, answer=self._wrong_answer(answer.answer, known))

    def _wrong_answer(self, answer: SceneLogAnswer, known: list[SceneLogPublic]) -> SceneLogAnswer | None:
        match self._liar.dice.randrange(4):
            case 0:
                return None
            case 1:
                # One of those that it has shown before, mostly an older one.
                return replace(answer, public=known[0], private=answer.private)
            case 2 if answer.private:
                return replace(answer, private=answer.private[:-1] + bytes((answer.private[-1] ^ 1,)))
            case _:
                ahead = self._ahead(answer.public)
                return replace(answer, position=ahead.position, public=self._liar.made_up.add_header(ahead, self._slot))

    def _ahead(self, public: SceneLogPublic) -> SceneLogPublic:
        """What nobody has decided. An owner is on the liar's side, and has signed it."""
        ahead = replace(public, position=public.position + FAR)
        owner = self._liar.owner() or self._liar.key
        ahead = replace(ahead, signature=owner.sign(HEADER_DOMAIN, ahead.signable()))
        # The node that decides could decide it, too: that one is trusted.
        decider = owner if public.origin == self._liar.node.node_id else self._liar.key
        return self._liar.dice.choice((ahead, ahead.proposed(), decided(ahead, decider)))
