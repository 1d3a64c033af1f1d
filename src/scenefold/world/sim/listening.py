"""How connections of a simulated network begin: a knock, an answer, two identities.

The client knocks (one and a half round trips: TCP, and TLS up to the node's certificate), hears who is there, and may
talk at once; the node sees the client's certificate half a round trip later, and only then serves it. As with TLS 1.3, a
client that is refused by the node learns it when it next receives.
"""

from __future__ import annotations

import logging
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import trio

from scenefold.base.errors import Unreachable
from scenefold.base.ids import node_id_of
from scenefold.base.limits import CONNECTIONS_MAX, HANDSHAKE_S_MAX, NEWCOMER_S_MAX
from scenefold.world.ports import ConnectionLost, Endpoint, Serve, ServeNewcomer
from scenefold.world.quiet import QuietLog
from scenefold.world.sim.machines import Machine, Process
from scenefold.world.sim.streams import SimConnection

if TYPE_CHECKING:
    from scenefold.world.sim.net import SimNet

KNOCK_AGAIN_S = 1.0
"""TCP sends its first packet again after a second."""

_log = logging.getLogger("scenefold.world.network")


class Listener:
    """A listening port of a process."""

    def __init__(
        self, net: SimNet, process: Process, machine: Machine, where: Endpoint, serve: Serve, newcomers: ServeNewcomer | None = None
    ) -> None:
        """`newcomers` serves who has no certificate."""
        self.process = process
        self._net = net
        self._machine = machine
        self._where = where
        self._serve = serve
        self.newcomers = newcomers
        self._arrived: deque[SimConnection] = deque()
        self._waiting = trio.lowlevel.ParkingLot()
        self._quiet = QuietLog(_log)
        self._open = 0
        machine.listeners[where.port] = self
        process.listeners[self] = None

    async def run(self, task_status: trio.TaskStatus[None]) -> None:
        try:
            async with trio.open_nursery() as nursery:
                task_status.started()
                while True:
                    nursery.start_soon(self._receive, await self._next())
        finally:
            self.close()

    def close(self) -> None:
        self.process.listeners.pop(self, None)
        if self._machine.listeners.get(self._where.port) is self:
            del self._machine.listeners[self._where.port]
        while self._arrived:
            self._arrived.popleft().abort()

    async def _next(self) -> SimConnection:
        while not self._arrived:
            await self._waiting.park()
        return self._arrived.popleft()

    async def _receive(self, connection: SimConnection) -> None:
        if self._open >= CONNECTIONS_MAX:
            self._refuse("full", f"refused: {CONNECTIONS_MAX} connections are open")
            connection.abort()
            return
        self._open += 1
        try:
            await self._serve_one(connection)
        except ConnectionLost as error:
            self._complain("lost", f"{connection.peer}: {error}")
        finally:
            self._open -= 1
            await connection.aclose()

    async def _serve_one(self, connection: SimConnection) -> None:
        if connection.peer:
            await self._serve(connection)
        elif self.newcomers is not None:
            with trio.move_on_after(NEWCOMER_S_MAX):
                # Everybody has a place here.
                await self.newcomers(connection, lambda _reason: None)

    def admit(self, connection: SimConnection, why_not: str) -> None:
        """The client's certificate arrives."""
        if why_not:
            self._refuse("stranger", f"connection refused: {why_not}")
            connection.abort()
        elif self not in self.process.listeners:
            connection.abort()
        else:
            self._arrived.append(connection)
            self._waiting.unpark()

    def turn_away(self) -> None:
        """A client found somebody else here than it wanted."""
        self._refuse("stranger", "connection refused: the connection was cut")

    def speaks_otherwise(self, client: Process) -> None:
        """A client takes no version of the protocol that the process here takes."""
        self._refuse("version", f"connection refused: {self.process.versions.apart_from(client.versions, client.name)}")

    def _refuse(self, kind: str, text: str) -> None:
        self.process.turned_away += 1
        self._complain(kind, text)

    def _complain(self, kind: str, text: str) -> None:
        self._quiet.say(self._net.now, self._where.address, kind, text)


@dataclass(slots=True, eq=False)
class Dial:
    """One attempt to connect."""

    process: Process
    address: str
    port: int
    is_newcomer: bool = False
    """It shows no certificate."""
    done: trio.Event = field(default_factory=trio.Event)
    connection: SimConnection | None = None
    shown: bytes = b""
    """The certificate that the node has shown."""
    failure: str = ""
    remedy: str = ""
    is_abandoned: bool = False

    def finish(self, connection: SimConnection | None, failure: str = "", remedy: str = "") -> None:
        self.connection, self.failure, self.remedy = connection, failure, remedy
        self.done.set()


async def connect(net: SimNet, process: Process, address: str, port: int) -> SimConnection:
    """Connect to a node; Unreachable with the reason if that is not possible."""
    connection, _shown = await dial(net, process, address, port)
    return connection


async def dial(net: SimNet, process: Process, address: str, port: int, *, is_newcomer: bool = False) -> tuple[SimConnection, bytes]:
    """Likewise; with the certificate that the node shows, if it has one."""
    await trio.lowlevel.checkpoint()
    where = f"{address}:{port}"
    if not process.is_alive:
        raise _unreachable(where, "the machine of this process has crashed")
    attempt = Dial(process, address, port, is_newcomer)
    net.after_trips((process.machine.name, address), 3, _knock, net, attempt)
    try:
        with trio.move_on_after(HANDSHAKE_S_MAX):
            await attempt.done.wait()
    finally:
        attempt.is_abandoned = attempt.connection is None
    if attempt.connection is None:
        raise _unreachable(where, attempt.failure or f"no answer within {HANDSHAKE_S_MAX:g} s", attempt.remedy)
    return attempt.connection, attempt.shown


def _knock(net: SimNet, dial: Dial) -> None:
    """The client's first packets are at the node."""
    here, there = dial.process.machine.name, dial.address
    machine = net.machine_at(there)
    if dial.is_abandoned or not dial.process.is_alive:
        return
    if machine is None or not net.reaches((here, there)) or not net.reaches((there, here)):
        net.after(KNOCK_AGAIN_S, _knock, net, dial)
        return
    held = net.held_until(machine)
    if held is not None:
        net.at(held, _knock, net, dial)
        return
    listener = machine.listeners.get(dial.port)
    if listener is None:
        net.after_trips((there, here), 1, dial.finish, None, "connection refused")
        return
    there_pipe, back_pipe = net.pipes(dial.process, listener.process, (here, there))
    client, node = dial.process, listener.process
    version = client.versions.common(node.versions) or 0
    name, key = ("", None) if dial.is_newcomer else (client.name, client.key)
    node_side = SimConnection(net, node, name, version, back_pipe, there_pipe, key)
    client_side = SimConnection(net, client, node.name, version, there_pipe, back_pipe, node.key)
    dial.shown = b"" if node.card is None else node.card.der
    net.after_trips((there, here), 1, _meet, dial, listener, client_side, node_side)


def _meet(dial: Dial, listener: Listener, client_side: SimConnection, node_side: SimConnection) -> None:
    """The node's certificate is at the client."""
    expected = f"node:{node_id_of(dial.address)}"
    stranger = listener.process.authority != dial.process.trusts
    out_of_date = dial.process.why_not_valid(listener.process)
    if dial.is_abandoned or not dial.process.is_alive or node_side.is_gone:
        client_side.abort()
        node_side.abort()
        dial.finish(None, "the connection was cut")
    elif dial.is_newcomer and listener.newcomers is None:
        listener.turn_away()
        client_side.abort()
        node_side.abort()
        dial.finish(None, "the node takes no newcomers")
    elif dial.is_newcomer:
        client_side.introduce(lambda node_side: listener.admit(node_side, ""))
        dial.finish(client_side)
    elif out_of_date:
        listener.turn_away()
        client_side.abort()
        node_side.abort()
        dial.finish(None, out_of_date)
    elif client_side.peer != expected or stranger:
        listener.turn_away()
        client_side.abort()
        node_side.abort()
        dial.finish(None, f"{client_side.peer} answers there instead of {expected}")
    elif not client_side.version:
        listener.speaks_otherwise(dial.process)
        client_side.abort()
        node_side.abort()
        problem = dial.process.versions.apart_from(listener.process.versions, client_side.peer)
        dial.finish(None, problem.what, problem.remedy)
    else:
        is_stranger = dial.process.authority != listener.process.trusts
        unknown = "its certificate is not valid here: unknown authority" if is_stranger else ""
        why_not = unknown or listener.process.why_not_valid(dial.process)
        client_side.introduce(lambda node_side: listener.admit(node_side, why_not))
        dial.finish(client_side)


def _unreachable(where: str, why: str, remedy: str = "") -> Unreachable:
    remedy = remedy or "see that the node runs there and belongs to this cluster (`scenectl cluster status`)"
    return Unreachable(f"no connection to the node: {why}", where=where, remedy=remedy)
