"""The door of a port: lets authenticated peers in, and keeps strangers from standing in their way.

Each connection that arrives gets a task; the handshake in it is bounded in time and in number, how often one source may try
says `Admission`, and what fails there is logged once a minute a source. Only then does the service see a `Connection`.
"""

from __future__ import annotations

import logging
import socket
import ssl
import time
from functools import partial

import trio

from scenefold.base.errors import PeerFault
from scenefold.base.limits import CONNECTIONS_MAX, HANDSHAKE_GAP_S, HELLO_S_MAX, NEWCOMER_S_MAX, NEWCOMERS_MAX, PENDING_HANDSHAKES_MAX
from scenefold.world.ports import ConnectionLost, Serve, ServeNewcomer
from scenefold.world.quiet import QuietLog
from scenefold.world.real.admission import HELLO_BYTES, Admission, begins_tls
from scenefold.world.real.handshake_turns import HandshakeTurns
from scenefold.world.real.handshakes import PendingHandshakes
from scenefold.world.real.tls import TlsConnection, shake_hands
from scenefold.world.versions import NoCommonVersion, Versions

_log = logging.getLogger("scenefold.world.network")


class Door:
    """Of one port."""

    def __init__(
        self, context: ssl.SSLContext, serve: Serve, newcomers: ServeNewcomer | None, versions: Versions, handshake_s_max: float
    ) -> None:
        self._context = context
        self._versions = versions
        self._serve = serve
        self._newcomers = newcomers
        self._newcomers_here = PendingHandshakes(NEWCOMERS_MAX)
        self._handshake_s_max = handshake_s_max
        self._quiet = QuietLog(_log)
        self._admission = Admission()
        self._pending = PendingHandshakes(PENDING_HANDSHAKES_MAX)
        self._turns = HandshakeTurns(HANDSHAKE_GAP_S)
        self._open = 0
        self.turned_away = 0
        """Connections that were refused: strangers', and what was too many. What is said of them once a minute is counted each time."""

    def may_knock(self, source: str) -> bool:
        """Whether a connection that has just come from an address is received at all; cheap."""
        if self._admission.may_knock(source, time.monotonic()):
            return True
        self._refuse(source, "knocks", "connections are closed: too many come, or their TLS handshakes fail, or are of one peer")
        return False

    async def receive(self, stream: trio.SocketStream) -> None:
        """One TCP connection from its arrival to its end; the stream is closed in any case."""
        source = _source_of(stream)
        connection = await self._authenticate(stream, source) if source else None
        if connection is None:
            return
        if not connection.peer:
            await self._receive_newcomer(connection, source)
            return
        self._admission.came_in(source, connection.peer, time.monotonic())
        if self._open >= CONNECTIONS_MAX:
            self._refuse(source, "full", f"refused: {CONNECTIONS_MAX} connections are open")
            return
        self._open += 1
        try:
            await self._serve(connection)
        except ConnectionLost as error:
            self._say(source, "lost", f"{connection.peer}: {error}")
        finally:
            self._open -= 1
            await connection.aclose()

    async def _receive_newcomer(self, connection: TlsConnection, source: str) -> None:
        began = time.monotonic()
        try:
            if self._newcomers is None:
                return
            if not self._admission.may_ask(source, began):
                self._refuse(source, "newcomers", "a newcomer is sent away: too many of this address showed no open invitation")
                return
            with trio.move_on_after(NEWCOMER_S_MAX) as scope:
                self._newcomers_here.admit(scope, source)
                try:
                    await self._newcomers(connection, partial(self._expect, scope, source))
                except ConnectionLost as error:
                    self._say(source, "newcomer", f"a newcomer: {error}")
                finally:
                    self._newcomers_here.leave(scope)
            if scope.cancelled_caught:
                why = "its time was over" if time.monotonic() - began >= NEWCOMER_S_MAX else "too many newcomers are at the door"
                self._refuse(source, "newcomers", f"a newcomer is sent away: {why}")
        finally:
            await connection.aclose()

    def _expect(self, scope: trio.CancelScope, source: str, invitation: bytes) -> None:
        self._newcomers_here.expect(scope, invitation)
        self._admission.was_expected(source, time.monotonic())

    async def _authenticate(self, stream: trio.SocketStream, source: str) -> TlsConnection | None:
        kind, why = "stranger", f"made no TLS handshake within {self._handshake_s_max:g} s"
        with trio.move_on_after(self._handshake_s_max) as scope:
            self._pending.admit(scope, source)
            try:
                # Looked at before TLS sets anything up: most of what strangers send fails here.
                first: bytes | None = None
                with trio.move_on_after(HELLO_S_MAX):
                    first = await stream.socket.recv(HELLO_BYTES, socket.MSG_PEEK)
                if first is None:
                    why = f"it said nothing within {HELLO_S_MAX:g} s"
                elif not begins_tls(first):
                    why = "what it says is not TLS" if first else "the connection was cut"
                elif self._admission.may_shake_hands(source, time.monotonic()):
                    await self._turns.wait()
                    return await shake_hands(stream, self._context, self._versions)
                else:
                    kind, why = "handshakes", "too many TLS handshakes of this address fail, or are of one peer"
            except NoCommonVersion as error:
                kind, why = "version", str(error)
            except (ConnectionLost, PeerFault, OSError) as error:
                why = str(error)
            finally:
                self._pending.leave(scope)
        if scope.cancelled_caught and trio.current_time() < scope.deadline:
            kind, why = "pushed out", f"pushed out by a newer one: {PENDING_HANDSHAKES_MAX} TLS handshakes are under way"
        self._refuse(source, kind, f"connection refused: {why}")
        return None

    def _refuse(self, source: str, kind: str, text: str) -> None:
        self.turned_away += 1
        self._say(source, kind, text)

    def _say(self, source: str, kind: str, text: str) -> None:
        self._quiet.say(time.monotonic(), source, kind, text)


def _source_of(stream: trio.SocketStream) -> str:
    """The address that a connection comes from; "" if it was reset before we looked at it."""
    try:
        return str(stream.socket.getpeername()[0])
    except OSError:
        return ""
