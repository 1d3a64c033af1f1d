"""Worlds that the suite runs on. A simulated one is added by a class like `RealWorlds` and a line in conftest.py."""

from __future__ import annotations

import secrets
import socket
from typing import Protocol

from scenefold.base.ids import node_id_of
from scenefold.crypto import Authority, Identity
from scenefold.store import LmdbDisk
from scenefold.world import Ports, World, real_world


class Worlds(Protocol):
    """Makes the worlds of one cluster's members, who can reach each other."""

    def address(self, number: int) -> str:
        """The address of a node of this cluster, 0 <= number < 100."""
        ...

    def node(self, number: int) -> World: ...

    def user(self, name: str) -> World: ...

    def stranger(self) -> World:
        """A user of another cluster, at the same place."""
        ...


class RealWorlds:
    """Sockets on a loopback network of this test's own, on ports that were free."""

    def __init__(self) -> None:
        # 127.0.0.0/8 is all loopback: a random part of it meets no other test and no demo.
        self._network = f"127.{secrets.randbelow(100) + 100}.{secrets.randbelow(256)}"
        self.ports = Ports(*free_ports(self.address(0)))
        self.authority = Authority.create("test")
        self._other_authority = Authority.create("other")

    def address(self, number: int) -> str:
        return f"{self._network}.{number + 1}"

    def identity(self, number: int) -> Identity:
        address = self.address(number)
        return self.authority.issue(f"node:{node_id_of(address)}", [address])

    def node(self, number: int) -> World:
        return self._world(self.identity(number), self.authority)

    def user(self, name: str) -> World:
        return self._world(self.authority.issue(f"user:{name}", []), self.authority)

    def stranger(self) -> World:
        # It trusts the cluster that it wants into, and has a certificate of its own cluster.
        return self._world(self._other_authority.issue("user:mallory", []), self.authority)

    def _world(self, identity: Identity, authority: Authority) -> World:
        return real_world(identity, authority.certificate, ports=self.ports, disk=LmdbDisk(map_bytes_first=1 << 20))


def free_ports(address: str) -> tuple[int, int]:
    """Two port numbers that nobody uses at an address."""
    with socket.socket() as one, socket.socket() as other:
        one.bind((address, 0))
        other.bind((address, 0))
        return one.getsockname()[1], other.getsockname()[1]
