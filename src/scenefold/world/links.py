"""Channels to the nodes that this process talks to, opened when needed and shared by all its tasks."""

from __future__ import annotations

import logging
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

import trio

from scenefold.base.errors import NotReached, Refused, Unreachable
from scenefold.wire import Packet
from scenefold.world.channel import Channel, open_channel
from scenefold.world.ports import Connection, Network, Priority, World
from scenefold.world.quiet import QuietLog
from scenefold.world.tasks import background_tasks

Key = tuple[str, Priority]


@dataclass(slots=True, eq=False)
class _Link:
    """One attempt to have a channel. All who ask meanwhile share it, and its failure."""

    settled: trio.Event = field(default_factory=trio.Event)
    channel: Channel | None = None
    failure: Unreachable | None = None

    @property
    def is_usable(self) -> bool:
        return not self.settled.is_set() or (self.channel is not None and self.channel.is_open)


class Links:
    """A pool of channels, one per address and priority; made by `open_links`."""

    def __init__(self, network: Network, nursery: trio.Nursery) -> None:
        self._network = network
        self._nursery = nursery
        self._links: dict[Key, _Link] = {}
        self._quiet = QuietLog(logging.getLogger("scenefold.world.links"))
        self._scopes: set[trio.CancelScope] = set()
        self._is_closed = False
        self.refusal_of: Callable[[Connection], Refused | None] = lambda _: None
        """Why a peer that answers, and has shown its certificate, is told and asked nothing. Set by who knows whose keys count."""
        self.on_lost: Callable[[str, Priority], None] = lambda _address, _priority: None
        """Called when a connection to an address is refused, or has ended."""

    def close(self) -> None:
        """End all channels."""
        self._is_closed = True
        for scope in self._scopes:
            scope.cancel()

    def check_again(self) -> None:
        """End the channels to those that are none of ours any more."""
        for link in list(self._links.values()):
            refusal = None if link.channel is None else self.refusal_of(link.channel.connection)
            if link.channel is not None and refusal is not None:
                link.channel.end(refusal.what)

    async def request(self, address: str, priority: Priority, packet: Packet, timeout_s: float) -> Packet:
        """Ask the node at an address, connecting first if need be, within `timeout_s` seconds in all.

        Errors are those of `Channel.request`. A request that failed may have been carried out, but after NotReached.
        """
        channel = None
        with trio.move_on_after(timeout_s):
            channel = await self._channel(address, priority)
            return await channel.request(packet, timeout_s)
        raise _too_slow(NotReached if channel is None else Unreachable, address, timeout_s)

    async def send(self, address: str, priority: Priority, packet: Packet, timeout_s: float, *, while_it_moves: bool = False) -> None:
        """Send a packet that has no answer; it is on its way when this returns.

        `while_it_moves`: what is before it on this connection may take longer, as long as some of it has left within `timeout_s`.
        """
        is_moving = True
        while is_moving:
            channel, since = None, trio.current_time()
            with trio.move_on_after(timeout_s):
                channel = await self._channel(address, priority)
                await channel.send(packet)
                return
            is_moving = while_it_moves and channel is not None and channel.is_open and channel.moved_at > since
        raise _too_slow(Unreachable, address, timeout_s)

    async def _channel(self, address: str, priority: Priority) -> Channel:
        key = (address, priority)
        link = self._links.get(key)
        if link is None or not link.is_usable:
            # The task belongs to the pool, so that a caller that gives up does not take the others' attempt along.
            link = self._links[key] = _Link()
            self._nursery.start_soon(self._keep, key, link)
        await link.settled.wait()
        if link.channel is None:
            assert link.failure is not None
            failure = link.failure
            kind = type(failure) if isinstance(failure, NotReached) else NotReached
            raise kind(failure.what, where=failure.where, remedy=failure.remedy) from failure
        return link.channel

    async def _keep(self, key: Key, link: _Link) -> None:
        """Connect, hold the channel as long as it lives, then forget it."""
        address, priority = key
        # Shielded: who is cancelled may want to say goodbye to a node, and its channel must not be gone by then.
        with trio.CancelScope(shield=True) as scope:
            self._scopes.add(scope)
            if self._is_closed:
                scope.cancel()
            try:
                connection = await self._network.connect(address, priority)
                refusal = self.refusal_of(connection)
                if refusal is not None:
                    await connection.aclose()
                    raise Unreachable(f"the node there is not talked to: {refusal.what}", where=address, remedy=refusal.remedy)
                async with open_channel(connection, address, self._quiet) as channel:
                    link.channel = channel
                    link.settled.set()
                    await channel.closed.wait()
            except Unreachable as error:
                link.failure = error
            finally:
                self._scopes.discard(scope)
                if link.channel is None and link.failure is None:
                    link.failure = Unreachable("the connections of this process are closed", where=address)
                link.settled.set()
                if self._links.get(key) is link:
                    del self._links[key]
                if not self._is_closed:
                    self.on_lost(address, priority)


@asynccontextmanager
async def open_links(world: World) -> AsyncIterator[Links]:
    """A pool that closes its channels at the end, and not before, also when its user is cancelled."""
    async with background_tasks() as nursery:
        links = Links(world.network, nursery)
        try:
            yield links
        finally:
            links.close()


def _too_slow(kind: type[Unreachable], address: str, timeout_s: float) -> Unreachable:
    return kind(f"the node does not answer within {timeout_s:g} s", where=address, remedy="see that it runs, then try again")
