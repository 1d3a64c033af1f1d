"""What a process sees of the network and the disk (ports `Network` and `Disk`)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import trio

from scenefold.base.errors import DamagedData, LocalFault
from scenefold.crypto import Card
from scenefold.world.ports import Endpoint, Priority, Serve, ServeNewcomer
from scenefold.world.sim.datagrams import EVERYWHERE, SimDatagrams
from scenefold.world.sim.disk import SimEnvironment
from scenefold.world.sim.listening import Listener, connect, dial
from scenefold.world.sim.machines import Process
from scenefold.world.sim.streams import SimConnection

if TYPE_CHECKING:
    from scenefold.world.sim.net import SimNet


class SimNetwork:
    """The network under the identity of one process."""

    def __init__(self, net: SimNet, process: Process) -> None:
        self._net = net
        self._process = process

    @property
    def turned_away(self) -> int:
        return self._process.turned_away

    async def listen(
        self,
        address: str,
        priority: Priority,
        serve: Serve,
        *,
        newcomers: ServeNewcomer | None = None,
        task_status: trio.TaskStatus[None] = trio.TASK_STATUS_IGNORED,
    ) -> None:
        await trio.lowlevel.checkpoint()
        port = self._net.ports.number(priority)
        machine = self._net.home(address, self._process)
        if port in machine.listeners:
            raise _in_use("TCP", address, port)
        await Listener(self._net, self._process, machine, Endpoint(address, port), serve, newcomers).run(task_status)

    async def connect(self, address: str, priority: Priority) -> SimConnection:
        return await connect(self._net, self._process, address, self._net.ports.number(priority))

    async def approach(self, address: str) -> tuple[SimConnection, bytes]:
        return await dial(self._net, self._process, address, self._net.ports.number(Priority.HIGH), is_newcomer=True)

    async def hear_broadcasts(self, address: str, priority: Priority) -> tuple[SimDatagrams, ...]:
        await trio.lowlevel.checkpoint()
        port = self._net.ports.number(priority)
        return (self._net.bind(self._process, address, port, hears_all=True),)

    async def open_broadcasts(self) -> tuple[SimDatagrams, tuple[Endpoint, ...]]:
        port = self._net.ports.number(Priority.HIGH)
        return await self.open_datagrams(None, Priority.HIGH), (Endpoint(EVERYWHERE, port),)

    def show(self, certificate: bytes) -> None:
        try:
            card = Card.read(certificate)
        except DamagedData as problem:
            raise LocalFault(
                f"the certificate or key is unusable: {problem.what}", where=self._process.name, remedy="issue it anew"
            ) from None
        if self._process.card is not None and card.tls_key != self._process.card.tls_key:
            raise LocalFault("the certificate or key is unusable: they do not match", where=self._process.name, remedy="issue it anew")
        self._process.card = card

    async def open_datagrams(self, address: str | None, priority: Priority) -> SimDatagrams:
        await trio.lowlevel.checkpoint()
        port = self._net.ports.number(priority)
        if address is not None and port in self._net.home(address, self._process).sockets:
            raise _in_use("UDP", address, port)
        return self._net.bind(self._process, address, port)


class ProcessDisk:
    """The disk of a process's machine; what it commits is a point of that process."""

    def __init__(self, net: SimNet, process: Process) -> None:
        self._net = net
        self._process = process

    def open(self, folder: Path, tables: Sequence[str], /) -> SimEnvironment:
        return self._process.machine.disk.open_for(folder, tables, self._passes)

    def _passes(self, what: str) -> bool:
        alive = self._process.passes_named(what)
        self._net.note(what.replace(" ", "-"), self._process.machine.name, "" if alive else "dead")
        return alive


def _in_use(kind: str, address: str, port: int) -> LocalFault:
    remedy = "stop the other process of this simulated machine"
    return LocalFault(f"{kind} port {port} is in use", where=f"{address}:{port}", remedy=remedy)
