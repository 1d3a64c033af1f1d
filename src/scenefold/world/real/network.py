"""TLS 1.3 over TCP, and UDP, on the two ports (port `Network`; design: wire, ports and carriers).

A node listens on its own address; who comes in there is judged by a `Door`.
"""

from __future__ import annotations

import os
from dataclasses import replace

import trio

from scenefold.base.errors import PeerFault, TurnedAway, Unreachable
from scenefold.base.ids import node_id_of
from scenefold.base.limits import HANDSHAKE_S_MAX
from scenefold.crypto import Identity, client_context, renew, server_context
from scenefold.world.ports import ConnectionLost, Endpoint, HandshakeRefused, Ports, Priority, Serve, ServeNewcomer
from scenefold.world.real.binding import bind_fault
from scenefold.world.real.broadcasts import hear_broadcasts, open_broadcasts
from scenefold.world.real.datagrams import RealDatagrams, open_datagrams
from scenefold.world.real.dialling import dial
from scenefold.world.real.door import Door
from scenefold.world.real.listening import GuardedListener
from scenefold.world.real.newcomers import approach
from scenefold.world.real.tls import TlsConnection, shake_hands
from scenefold.world.versions import NEWCOMER, TAKEN, NoCommonVersion, Versions


class RealNetwork:
    """Sockets under the identity of one node or user."""

    def __init__(
        self,
        identity: Identity,
        authority_cert: bytes,
        ports: Ports,
        *,
        versions: Versions = TAKEN,
        handshake_s_max: float = HANDSHAKE_S_MAX,
    ) -> None:
        self._identity = identity
        self._authority_cert = authority_cert
        self._versions = versions
        self._client_context = client_context(identity, authority_cert)
        self._client_context.set_alpn_protocols(versions.names)
        self._contexts = [self._client_context]
        """All that show our certificate."""
        self._ports = ports
        self._handshake_s_max = handshake_s_max
        self._doors: list[Door] = []

    @property
    def turned_away(self) -> int:
        return sum(door.turned_away for door in self._doors)

    async def listen(
        self,
        address: str,
        priority: Priority,
        serve: Serve,
        *,
        newcomers: ServeNewcomer | None = None,
        task_status: trio.TaskStatus[None] = trio.TASK_STATUS_IGNORED,
    ) -> None:
        port = self._ports.number(priority)
        # Made here and not at the start: a client's identity cannot serve.
        context = server_context(self._identity, self._authority_cert, newcomers=newcomers is not None)
        context.set_alpn_protocols([*self._versions.names, *([NEWCOMER] if newcomers is not None else [])])
        try:
            listeners = await trio.open_tcp_listeners(port, host=address)
        except OSError as error:
            raise bind_fault(error, "TCP", address, port) from error
        door = Door(context, serve, newcomers, self._versions, self._handshake_s_max)
        self._doors.append(door)
        guarded = [GuardedListener(listener, door.may_knock) for listener in listeners]
        self._contexts.append(context)
        try:
            async with trio.open_nursery() as nursery:
                await nursery.start(trio.serve_listeners, door.receive, guarded)
                task_status.started()
        finally:
            self._contexts.remove(context)

    def show(self, certificate: bytes) -> None:
        newer = replace(self._identity, certificate=certificate)
        # Tried on a context of its own: one that takes only half of it would show nothing usable any more.
        client_context(newer, self._authority_cert)
        self._identity = newer
        for context in self._contexts:
            renew(context, newer)

    async def connect(self, address: str, priority: Priority) -> TlsConnection:
        port = self._ports.number(priority)
        where = f"{address}:{port}"
        try:
            with trio.fail_after(self._handshake_s_max):
                connection = await self._connect(address, port)
        except OSError as error:
            # Trio's own text repeats the address; ours names it already.
            raise _unreachable(where, os.strerror(error.errno) if error.errno else str(error)) from error
        except trio.TooSlowError:
            raise _unreachable(where, f"no answer within {self._handshake_s_max:g} s") from None
        except NoCommonVersion as error:
            raise _unreachable(where, error.what, error.remedy, kind=TurnedAway) from error
        except (HandshakeRefused, PeerFault) as error:
            raise _unreachable(where, str(error), kind=TurnedAway) from error
        except ConnectionLost as error:
            raise _unreachable(where, str(error)) from error
        expected = f"node:{node_id_of(address)}"
        if connection.peer != expected:
            await connection.aclose()
            raise _unreachable(where, f"{connection.peer} answers there instead of {expected}", kind=TurnedAway)
        return connection

    async def _connect(self, address: str, port: int) -> TlsConnection:
        stream = await dial(address, port)
        try:
            return await shake_hands(stream, self._client_context, self._versions, dialled=address)
        except BaseException:
            await trio.aclose_forcefully(stream)
            raise

    async def approach(self, address: str) -> tuple[TlsConnection, bytes]:
        return await approach(address, self._ports.number(Priority.HIGH))

    async def open_broadcasts(self) -> tuple[RealDatagrams, tuple[Endpoint, ...]]:
        return await open_broadcasts(self._ports.number(Priority.HIGH))

    async def open_datagrams(self, address: str | None, priority: Priority) -> RealDatagrams:
        return await open_datagrams(address, priority, self._ports)

    async def hear_broadcasts(self, address: str, priority: Priority) -> tuple[RealDatagrams, ...]:
        return await hear_broadcasts(address, self._ports.number(priority))


def _unreachable(where: str, why: str, remedy: str = "", *, kind: type[Unreachable] = Unreachable) -> Unreachable:
    remedy = remedy or "see that the node runs there and belongs to this cluster (`scenectl cluster status`)"
    return kind(f"no connection to the node: {why}", where=where, remedy=remedy)
