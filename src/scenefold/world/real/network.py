"""TLS 1.3 over TCP, and UDP, on the two ports (port `Network`; design: wire, ports and carriers).

A node listens on its own address. Each connection that arrives gets a task; the handshake in it is bounded in time
and in number, and what fails there is logged once a minute a source. Only then does the service see a `Connection`.
"""

from __future__ import annotations

import logging
import os
import ssl
import time
from dataclasses import replace

import trio

from scenefold.base.errors import PeerFault, TurnedAway, Unreachable
from scenefold.base.ids import node_id_of
from scenefold.base.limits import CONNECTIONS_MAX, HANDSHAKE_S_MAX, NEWCOMER_S_MAX, NEWCOMERS_MAX, PENDING_HANDSHAKES_MAX
from scenefold.crypto import Identity, client_context, renew, server_context
from scenefold.world.ports import ConnectionLost, HandshakeRefused, Ports, Priority, Serve
from scenefold.world.quiet import QuietLog
from scenefold.world.real.binding import bind_fault
from scenefold.world.real.broadcasts import hear_broadcasts
from scenefold.world.real.datagrams import RealDatagrams, open_datagrams
from scenefold.world.real.handshakes import PendingHandshakes
from scenefold.world.real.tls import TlsConnection, shake_hands
from scenefold.world.versions import NEWCOMER, TAKEN, NoCommonVersion, Versions

_log = logging.getLogger("scenefold.world.network")


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

    async def listen(
        self,
        address: str,
        priority: Priority,
        serve: Serve,
        *,
        newcomers: Serve | None = None,
        task_status: trio.TaskStatus[None] = trio.TASK_STATUS_IGNORED,
    ) -> None:
        port = self._ports.number(priority)
        try:
            listeners = await trio.open_tcp_listeners(port, host=address)
        except OSError as error:
            raise bind_fault(error, "TCP", address, port) from error
        # Made here and not at the start: a client's identity cannot serve.
        context = server_context(self._identity, self._authority_cert, newcomers=newcomers is not None)
        context.set_alpn_protocols([*self._versions.names, *([NEWCOMER] if newcomers is not None else [])])
        door = _Door(context, serve, newcomers, self._versions, self._handshake_s_max)
        self._contexts.append(context)
        try:
            async with trio.open_nursery() as nursery:
                await nursery.start(trio.serve_listeners, door.receive, listeners)
                task_status.started()
        finally:
            self._contexts.remove(context)

    def show(self, certificate: bytes) -> None:
        self._identity = replace(self._identity, certificate=certificate)
        for context in self._contexts:
            renew(context, self._identity)

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
        socket = trio.socket.socket()
        try:
            await socket.connect((address, port))
        except BaseException:
            socket.close()
            raise
        stream = trio.SocketStream(socket)
        try:
            return await shake_hands(stream, self._client_context, self._versions, dialled=address)
        except BaseException:
            await trio.aclose_forcefully(stream)
            raise

    async def open_datagrams(self, address: str | None, priority: Priority) -> RealDatagrams:
        return await open_datagrams(address, priority, self._ports)

    async def hear_broadcasts(self, address: str, priority: Priority) -> tuple[RealDatagrams, ...]:
        return await hear_broadcasts(address, self._ports.number(priority))


class _Door:
    """Lets authenticated peers in and keeps strangers from standing in their way."""

    def __init__(self, context: ssl.SSLContext, serve: Serve, newcomers: Serve | None, versions: Versions, handshake_s_max: float) -> None:
        self._context = context
        self._versions = versions
        self._serve = serve
        self._newcomers = newcomers
        self._newcomers_here = PendingHandshakes(NEWCOMERS_MAX)
        self._handshake_s_max = handshake_s_max
        self._quiet = QuietLog(_log)
        self._pending = PendingHandshakes(PENDING_HANDSHAKES_MAX)
        self._open = 0

    async def receive(self, stream: trio.SocketStream) -> None:
        """One TCP connection from its arrival to its end; the stream is closed in any case."""
        try:
            source = str(stream.socket.getpeername()[0])
        except OSError:
            return  # It was reset before we looked at it.
        connection = await self._authenticate(stream, source)
        if connection is None:
            return
        if not connection.peer:
            await self._receive_newcomer(connection, source)
            return
        if self._open >= CONNECTIONS_MAX:
            self._quiet.say(time.monotonic(), source, "full", f"refused: {CONNECTIONS_MAX} connections are open")
            return
        self._open += 1
        try:
            await self._serve(connection)
        except ConnectionLost as error:
            self._quiet.say(time.monotonic(), source, "lost", f"{connection.peer}: {error}")
        finally:
            self._open -= 1
            await connection.aclose()

    async def _receive_newcomer(self, connection: TlsConnection, source: str) -> None:
        began = time.monotonic()
        try:
            if self._newcomers is None:
                return
            with trio.move_on_after(NEWCOMER_S_MAX) as scope:
                self._newcomers_here.admit(scope, source)
                try:
                    await self._newcomers(connection)
                except ConnectionLost as error:
                    self._quiet.say(time.monotonic(), source, "newcomer", f"a newcomer: {error}")
                finally:
                    self._newcomers_here.leave(scope)
            if scope.cancelled_caught:
                why = "its time was over" if time.monotonic() - began >= NEWCOMER_S_MAX else "too many newcomers are at the door"
                self._quiet.say(time.monotonic(), source, "newcomers", f"a newcomer is sent away: {why}")
        finally:
            await connection.aclose()

    async def _authenticate(self, stream: trio.SocketStream, source: str) -> TlsConnection | None:
        kind, why = "stranger", f"made no TLS handshake within {self._handshake_s_max:g} s"
        with trio.move_on_after(self._handshake_s_max) as scope:
            self._pending.admit(scope, source)
            try:
                return await shake_hands(stream, self._context, self._versions)
            except NoCommonVersion as error:
                kind, why = "version", str(error)
            except (ConnectionLost, PeerFault, OSError) as error:
                why = str(error)
            finally:
                self._pending.leave(scope)
        self._quiet.say(time.monotonic(), source, kind, f"connection refused: {why}")
        return None


def _unreachable(where: str, why: str, remedy: str = "", *, kind: type[Unreachable] = Unreachable) -> Unreachable:
    remedy = remedy or "see that the node runs there and belongs to this cluster (`scenectl cluster status`)"
    return kind(f"no connection to the node: {why}", where=where, remedy=remedy)
