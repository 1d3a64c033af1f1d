"""Statuses from node to node over UDP, packets 1 and 2 (thesis B.2.2, C.1; specs/11-peers.md, Gossip).

Once a second, with probability 1/N, a node sends its own signed status to every other, and as much of its table as
fits one datagram. A node that starts asks its seeds and everybody it has not heard yet (RequestState), so that a
table is complete within a round trip and not only after a few minutes of luck.

A datagram counts if it is signed with the registered key of its sender, and a status in it if it is signed with that of
the node that it describes, whoever passes it on. All else is dropped, counted, and logged at most once a minute. There
is no replay window: a status that does not rise has no effect, and an answer goes to the registered address of who
asked, so a repeated datagram gains little; so that a small one repeated is no flood of large ones, who asks again and
again is answered only so often. And a node whose folder was made anew begins its counters anew.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping, Sequence

import trio

from scenefold.base.errors import DamagedData
from scenefold.base.ids import NodeId, address_of
from scenefold.base.limits import DATAGRAM_BYTES_MAX
from scenefold.crypto import (
    DATAGRAM_OVERHEAD_BYTES,
    EVERYBODY,
    STATUS_DOMAIN,
    PublicKey,
    parse_datagram,
    sign_datagram,
    verify_datagram,
)
from scenefold.peer.roster import Roster
from scenefold.peer.routing import Routing
from scenefold.peer.status import OwnStatus
from scenefold.wire import MalformedPacket, Packet, PingBroadcast, RequestState, Status, decode_packet, encode_packet
from scenefold.world.ports import Datagrams, Endpoint, Priority, World
from scenefold.world.quiet import QuietLog

ROUND_S = 1.0
"""Time between two throws of the dice (thesis B.2.2)."""
KNOCK_S_MIN = 0.1
KNOCK_S_MAX = 2.0
"""A node that is not heard yet is asked again after 0.1 s, then ever more slowly."""
ANSWER_S_MIN = 0.05
"""Time between two answers to one node, which asks every KNOCK_S_MIN at most."""

_log = logging.getLogger("scenefold.peer.gossip")


class Gossip:
    """Hears and speaks on the high-priority UDP port of one node."""

    def __init__(
        self,
        world: World,
        own: OwnStatus,
        roster: Roster,
        routing: Routing,
        keys: Mapping[NodeId, PublicKey],
        seeds: Iterable[str] = (),
    ) -> None:
        self._world = world
        self._own = own
        self._roster = roster
        self._routing = routing
        self._keys = keys
        self._addresses = {address_of(member): member for member in keys}
        self._me = address_of(own.me)
        self._seeds = [seed for seed in seeds if seed != self._me]
        self._news = trio.Condition()
        self._quiet = QuietLog(_log)
        self._answered_at: dict[NodeId, float] = {}
        self.dropped = 0
        """Datagrams and statuses that did not verify, since the start."""

    async def run(self, *, task_status: trio.TaskStatus[None] = trio.TASK_STATUS_IGNORED) -> None:
        """Gossip until cancelled. Started once the port is open; LocalFault if it cannot be had."""
        datagrams = await self._world.network.open_datagrams(self._me, Priority.HIGH)
        try:
            async with trio.open_nursery() as nursery:
                nursery.start_soon(self._listen, datagrams)
                nursery.start_soon(self._speak, datagrams)
                nursery.start_soon(self._knock, datagrams)
                task_status.started()
        finally:
            with trio.CancelScope(shield=True):
                await datagrams.aclose()

    async def everybody_heard(self) -> None:
        """Return once every member has been heard since the start."""
        async with self._news:
            while self._roster.unheard():
                await self._news.wait()

    async def somebody_heard(self) -> None:
        """Return once any other member has been heard; at once if there is none."""
        async with self._news:
            while len(self._roster.unheard()) == self._roster.count - 1 > 0:
                await self._news.wait()

    async def a_seed_heard(self) -> None:
        """Return once a seed has been heard; at once if there is none but this node."""
        async with self._news:
            while self._seeds and not self._heard_seeds():
                await self._news.wait()

    @property
    def seeds(self) -> Sequence[str]:
        """The seeds other than this node."""
        return tuple(self._seeds)

    def _heard_seeds(self) -> list[str]:
        ids = ((seed, self._addresses.get(seed)) for seed in self._seeds)
        return [seed for seed, member in ids if member is not None and self._roster.heard_at(member) is not None]

    async def _speak(self, datagrams: Datagrams) -> None:
        while True:
            await self._world.clock.sleep(ROUND_S)
            if self._world.entropy.uniform() * self._roster.count >= 1:
                continue
            self._roster.count_broadcast(())
            page = self._page(0)
            for address, member in self._addresses.items():
                if member != self._own.me:
                    await datagrams.send(page, address)

    async def _knock(self, datagrams: Datagrams) -> None:
        """Ask who has not been heard, seeds included: they know others, even where we were told no member."""
        pause = KNOCK_S_MIN
        while True:
            unheard = [address_of(member) for member in self._roster.unheard()]
            silent_seeds = set(self._seeds) - set(self._heard_seeds())
            for address in sorted({*unheard, *silent_seeds}):
                await datagrams.send(self._sealed(RequestState(request_id=1)), address)
            await self._world.clock.sleep(pause)
            pause = min(pause * 1.5, KNOCK_S_MAX)

    async def _listen(self, datagrams: Datagrams) -> None:
        while True:
            data, source = await datagrams.receive()
            try:
                sender, packet = self._opened(data)
            except (DamagedData, MalformedPacket) as problem:
                self._drop(source, "forged", f"a datagram is dropped: {problem}")
                continue
            if isinstance(packet, PingBroadcast):
                await self._hear(packet, sender, source)
            elif isinstance(packet, RequestState):
                await self._tell(sender, packet.request_id, datagrams)
            else:
                self._drop(source, "unexpected", f"a {type(packet).__name__} has no business here")

    async def _tell(self, sender: NodeId, request_id: int, datagrams: Datagrams) -> None:
        now = self._world.clock.now()
        if now - self._answered_at.get(sender, now - ANSWER_S_MIN) < ANSWER_S_MIN:
            return
        self._answered_at[sender] = now
        await datagrams.send(self._page(request_id, sender), address_of(sender))
        if sender in self._roster.unheard():
            # It lives, but has said nothing of itself yet. It has heard us by then, so this ends here.
            await datagrams.send(self._sealed(RequestState(request_id=1)), address_of(sender))

    def _opened(self, data: bytes) -> tuple[NodeId, Packet]:
        datagram = parse_datagram(data)
        key = self._keys.get(datagram.sender)
        if key is None or datagram.target not in (EVERYBODY, self._own.me):
            raise DamagedData(f"it is from {address_of(datagram.sender)} for {address_of(datagram.target)}")
        return datagram.sender, decode_packet(verify_datagram(datagram, key))

    def _sealed(self, packet: Packet, target: NodeId = EVERYBODY) -> bytes:
        return sign_datagram(self._own.key, self._own.me, self._own.next(), encode_packet(packet), target=target)

    async def _hear(self, packet: PingBroadcast, sender: NodeId, source: Endpoint) -> None:
        heard = [status.node for status in packet.statuses if self._take(status, sender, source)]
        if packet.request_id == 0 and heard:
            # Answers to RequestState are no throw of the dice, so they say nothing about who stayed silent.
            self._roster.count_broadcast(heard)
        if heard:
            async with self._news:
                self._news.notify_all()

    def _take(self, status: Status, sender: NodeId, source: Endpoint) -> bool:
        relayed = status.node != sender
        if not self._roster.rises(status, relayed=relayed):
            return False
        problem = self._problem_of(status)
        if problem:
            self._drop(source, "status", f"a status of {address_of(status.node)} is dropped: {problem}")
            return False
        return self._roster.hear(status, self._world.clock.now(), relayed=relayed)

    def _problem_of(self, status: Status) -> str:
        """Why a status must not count; empty if it may."""
        try:
            self._keys[status.node].verify(status.signature, STATUS_DOMAIN, status.signable())
        except DamagedData as error:
            return str(error)
        if status.address != address_of(status.node):
            return f"it claims the address {status.address}"
        if status.right_bound != self._routing.arc_of(status.node).last:
            return "it claims an arc that is not its own: is its cluster.toml the same as ours?"
        return ""

    def _page(self, request_id: int, target: NodeId = EVERYBODY) -> bytes:
        own = self._own.signed()
        others = self._roster.page(_PAGE_BYTES - _size_of(own), _size_of)
        return self._sealed(PingBroadcast((own, *others), request_id=request_id), target)

    def _drop(self, source: Endpoint, kind: str, text: str) -> None:
        self.dropped += 1
        self._quiet.say(self._world.clock.now(), source.address, kind, text)


_EMPTY_PING_BYTES = len(encode_packet(PingBroadcast(())))
_HEADS_BYTES = 6
"""What the heads of a request id and of a longer array may add."""
_PAGE_BYTES = DATAGRAM_BYTES_MAX - DATAGRAM_OVERHEAD_BYTES - _EMPTY_PING_BYTES - _HEADS_BYTES


def _size_of(status: Status) -> int:
    return len(encode_packet(PingBroadcast((status,)))) - _EMPTY_PING_BYTES
