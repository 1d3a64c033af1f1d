"""Worlds that the suite runs on: the real one and the simulated one."""

from __future__ import annotations

import datetime
import os
import resource
import secrets
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import trio
import trio.testing

from loopback import free_ports
from scenefold.base.ids import node_id_of
from scenefold.crypto import Authority, Card, Identity, MemberKeys
from scenefold.store import LmdbDisk
from scenefold.store.lmdb_disk import DATA_NAME
from scenefold.world import World, newcomer_world, real_world
from scenefold.world.sim import SimNet
from scenefold.world.sim.clock import WALL_BEGIN
from scenefold.world.versions import TAKEN, Versions

DESCRIPTORS = Path("/proc/self/fd")
"""The open files of this process, where the system shows them."""
SIM_NOW = datetime.datetime.fromtimestamp(WALL_BEGIN, datetime.UTC) - datetime.timedelta(days=1)
LOCK_BYTES = 64
"""What a lock file needs, on a disk on which no store fits."""
INSIDE_BYTES = 1 << 20
"""What a file can take that grows no more."""


Renew = Callable[[MemberKeys], bytes]
"""A certificate (PEM) for other keys, and the same TLS key."""


@dataclass
class Lasting:
    """`work` is a call for a lane. `begun` is set when the first has begun; `ended` counts those that are over."""

    seconds: float
    soon: Callable[[Callable[[], None]], None]
    """Calls back in the thread of the tasks."""
    begun: trio.Event = field(default_factory=trio.Event)
    done: threading.Event = field(default_factory=threading.Event)
    ended: int = 0

    def work(self) -> str:
        self.soon(self.begun.set)
        self.done.wait(self.seconds)
        self.ended += 1
        return "worked"


class Worlds(Protocol):
    """Makes the worlds of one cluster's members, who can reach each other."""

    def address(self, number: int) -> str:
        """The address of a node of this cluster, 0 <= number < 100."""
        ...

    def node(self, number: int, versions: Versions = TAKEN) -> World: ...

    def certified(self, number: int, keys: MemberKeys) -> tuple[World, Renew]:
        """The same, with a certificate that names the node's other keys, and what issues a newer one for the same TLS key."""
        ...

    def user(self, name: str, versions: Versions = TAKEN) -> World:
        """`versions` of the protocol that its program takes."""
        ...

    def stranger(self) -> World:
        """A user of another cluster, at the same place."""
        ...

    def newcomer(self) -> World:
        """Somebody nearby without a certificate."""
        ...

    async def silence(self, seconds: float) -> None:
        """Wait until no task has anything to do for so long, and nothing is on its way."""
        ...

    def lasting(self, number: int, seconds: float) -> Lasting:
        """Work that takes at least so long in lane `store` of a node, or goes on until `done` is set, in a world where that is possible."""
        ...

    def full(self, number: int, folder: Path) -> AbstractContextManager[None]:
        """While this lasts there is no room on the disk of a node, but for what is left within the file of a folder."""
        ...

    def failing(self, number: int, folder: Path) -> AbstractContextManager[None]:
        """While this lasts nothing can be written into an open folder."""
        ...


class RealWorlds:
    """Sockets on a loopback network of this test's own, on ports that were free."""

    def __init__(self) -> None:
        # 127.0.0.0/8 is all loopback: a random part of it meets no other test and no demo.
        self._network = f"127.{secrets.randbelow(100) + 100}.{secrets.randbelow(256)}"
        self.ports = free_ports([self.address(0)])
        self.authority = Authority.create("test")
        self._other_authority = Authority.create("other")

    def address(self, number: int) -> str:
        return f"{self._network}.{number + 1}"

    def identity(self, number: int) -> Identity:
        address = self.address(number)
        return self.authority.issue(f"node:{node_id_of(address)}", [address])

    def node(self, number: int, versions: Versions = TAKEN) -> World:
        return self._world(self.identity(number), self.authority, versions)

    def certified(self, number: int, keys: MemberKeys) -> tuple[World, Renew]:
        name, addresses = f"node:{node_id_of(self.address(number))}", [self.address(number)]
        identity = self.authority.issue(name, addresses, keys=keys)
        tls_key = Card.read(identity.certificate).tls_key
        renew = lambda keys: self.authority.certify(name, addresses, tls_key, keys=keys)  # noqa: E731
        return self._world(identity, self.authority), renew

    def user(self, name: str, versions: Versions = TAKEN) -> World:
        return self._world(self.authority.issue(f"user:{name}", []), self.authority, versions)

    def stranger(self) -> World:
        # It trusts the cluster that it wants into, and has a certificate of its own cluster.
        return self._world(self._other_authority.issue("user:mallory", []), self.authority)

    def newcomer(self) -> World:
        return newcomer_world(self.ports)

    async def silence(self, seconds: float) -> None:
        await trio.testing.wait_all_tasks_blocked(seconds)

    def lasting(self, number: int, seconds: float) -> Lasting:
        return Lasting(seconds, trio.lowlevel.current_trio_token().run_sync_soon)

    @contextmanager
    def full(self, number: int, folder: Path) -> Iterator[None]:
        # The kernel answers at this limit as a full disk does; Python ignores the signal that comes with it.
        before = resource.getrlimit(resource.RLIMIT_FSIZE)
        path = folder / DATA_NAME
        present_bytes = path.stat().st_size if path.exists() else LOCK_BYTES
        resource.setrlimit(resource.RLIMIT_FSIZE, (present_bytes, before[1]))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)

    @contextmanager
    def failing(self, number: int, folder: Path) -> Iterator[None]:
        # Every descriptor of the file becomes one that can only read, beneath those who hold them.
        path = folder / DATA_NAME
        held = [int(entry.name) for entry in DESCRIPTORS.iterdir() if entry.is_symlink() and entry.readlink() == path.resolve()]
        assert held, "nobody has the folder open"
        kept = {descriptor: os.dup(descriptor) for descriptor in held}
        unwritable = os.open(path, os.O_RDONLY)
        for descriptor in held:
            os.dup2(unwritable, descriptor, inheritable=False)
        try:
            yield
        finally:
            for descriptor, whole in kept.items():
                os.dup2(whole, descriptor, inheritable=False)
                os.close(whole)
            os.close(unwritable)

    def _world(self, identity: Identity, authority: Authority, versions: Versions = TAKEN) -> World:
        disk = LmdbDisk(map_bytes_first=1 << 20)
        return real_world(identity, authority.certificate, ports=self.ports, disk=disk, versions=versions)


class SimWorlds:
    """Machines of one simulated network; its tests run in virtual time (conftest.py)."""

    def __init__(self, seed: int = 1) -> None:
        self.net = SimNet(seed)

    def address(self, number: int) -> str:
        return f"10.0.0.{number + 1}"

    def node(self, number: int, versions: Versions = TAKEN) -> World:
        return self.net.world(f"node:{node_id_of(self.address(number))}", self.address(number), versions=versions)

    def certified(self, number: int, keys: MemberKeys) -> tuple[World, Renew]:
        # By the clocks of these machines.
        authority, now = Authority.create("test", now=SIM_NOW), SIM_NOW
        name, addresses = f"node:{node_id_of(self.address(number))}", [self.address(number)]
        identity = authority.issue(name, addresses, keys=keys, now=now)
        tls_key = Card.read(identity.certificate).tls_key
        renew = lambda keys: authority.certify(name, addresses, tls_key, keys=keys, now=now)  # noqa: E731
        return self.net.world(name, self.address(number), certificate=identity.certificate), renew

    def user(self, name: str, versions: Versions = TAKEN) -> World:
        return self.net.world(f"user:{name}", versions=versions)

    def stranger(self) -> World:
        return self.net.world("user:mallory", authority="other")

    def newcomer(self) -> World:
        return self.net.world("newcomer")

    async def silence(self, seconds: float) -> None:
        # What is on its way takes virtual time, and nothing else does.
        await trio.sleep(seconds)
        await trio.testing.wait_all_tasks_blocked()

    def lasting(self, number: int, seconds: float) -> Lasting:
        # Calls are atomic here; it is the disk that lets virtual time pass on both sides of one.
        self.net.machine(self.address(number)).disk.slow(seconds)
        return Lasting(0.0, lambda tell: tell())

    @contextmanager
    def full(self, number: int, folder: Path) -> Iterator[None]:
        disk = self.net.machine(self.address(number)).disk
        # A file that is there has some room inside, as LMDB's has; one that is not cannot begin.
        disk.fill(INSIDE_BYTES if disk.peek("rows") else 0)
        try:
            yield
        finally:
            disk.fill(None)

    @contextmanager
    def failing(self, number: int, folder: Path) -> Iterator[None]:
        disk = self.net.machine(self.address(number)).disk
        disk.fails = True
        try:
            yield
        finally:
            disk.fails = False
