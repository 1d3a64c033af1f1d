"""The one seam to the outside: clock, entropy, worker threads, network and disk (design: architecture, three ideas).

Services above this floor reach the machine only through these five ports, gathered in one `World`. `world.real`
implements them with Trio sockets, TLS and threads; a simulated world implements the same protocols in memory. Both
must pass tests/conformance/world, so what is written here is a promise, not a hint.

Deadlines in services are Trio's own (`trio.fail_after`): a simulated world runs Trio on a virtual clock, and its
`Clock` reads that one. Nothing here speaks of sockets, files or threads, so a world without any can keep it.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import NamedTuple, Protocol, TypeVar

import trio

from scenefold.base.ids import KeyId
from scenefold.base.limits import PORT_HIGH_PRIORITY, PORT_LOW_PRIORITY

T = TypeVar("T")


class Priority(IntEnum):
    """Which of the two ports traffic takes, so that an administrator can queue them apart."""

    LOW = 0
    HIGH = 1


@dataclass(frozen=True, slots=True)
class Ports:
    """The port numbers of a cluster, for TCP and UDP alike. All of its nodes use the same two."""

    low: int = PORT_LOW_PRIORITY
    high: int = PORT_HIGH_PRIORITY

    def number(self, priority: Priority) -> int:
        return self.high if priority is Priority.HIGH else self.low


class Endpoint(NamedTuple):
    """Where a datagram came from, or goes to."""

    address: str
    port: int


class ConnectionLost(Exception):
    """The connection is gone: cut, reset, refused by the peer's TLS, or closed by us. The text says which."""


class HandshakeRefused(ConnectionLost):
    """TLS forbids the connection: a certificate of another authority, or of none."""


class DiskFull(Exception):
    """The disk took nothing of this change: no room, or a quota. What was durable before still is."""


class DiskFailed(Exception):
    """The disk failed in a way that leaves open whether this change is durable. Nothing more may be written."""


class Clock(Protocol):
    """Time as this node sees it. Two nodes' clocks are never compared."""

    def now(self) -> float:
        """Seconds on a clock that never goes back, and goes on while the machine sleeps; its zero means nothing.

        So who was suspended finds its leases expired, where Trio's deadlines may have stood still meanwhile.
        """
        ...

    def wall(self) -> float:
        """Seconds since 1970, for people and for file names; it may jump."""
        ...

    @property
    def stopwatch(self) -> Callable[[], float] | None:
        """Seconds as in `now`, but cheap, for what lasts moments. None where computing takes no time: in a simulation."""
        ...

    async def sleep(self, seconds: float) -> None: ...


class Entropy(Protocol):
    """Randomness. `token` is fit for keys and nonces in the real world; a simulation draws both from its seed."""

    def token(self, count: int) -> bytes:
        """`count` random bytes."""
        ...

    def uniform(self) -> float:
        """A random number, 0 <= x < 1."""
        ...


class Workers(Protocol):
    """Threads for what computes or blocks, in lanes, so that a full lane never holds up another."""

    async def run(self, lane: str, function: Callable[..., T], *args: object) -> T:
        """Run `function(*args)` in a lane and return what it returns, or raise what it raises.

        The wait for a free thread can be cancelled. A call that has begun is waited for, so that nothing works on
        in the dark after its caller has gone: keep calls short, or let them look at a flag.
        """
        ...


class Connection(Protocol):
    """An authenticated, ordered, encrypted stream of bytes to one peer."""

    @property
    def peer(self) -> str:
        """The name in the peer's certificate: "node:<id>" or "user:<name>"; empty of a newcomer, which has none."""
        ...

    @property
    def peer_key(self) -> KeyId | None:
        """The id of the key that the peer signs with, by its certificate; None if it names none."""
        ...

    @property
    def version(self) -> int:
        """The version of the protocol that both ends have agreed on."""
        ...

    async def send(self, data: bytes | memoryview) -> None:
        """Send everything; ConnectionLost if that is impossible. Cancelled, it leaves the stream unusable."""
        ...

    async def receive(self, count_max: int) -> bytes:
        """At least one byte and at most `count_max`; b"" when the peer has closed in order. ConnectionLost otherwise."""
        ...

    async def aclose(self) -> None:
        """Close in order if the peer allows it at once, else hard."""
        ...


Serve = Callable[[Connection], Awaitable[None]]
ServeNewcomer = Callable[[Connection, Callable[[bytes], None]], Awaitable[None]]
"""Calls back once it knows why the newcomer is expected: then others do not push it out, unless one is here for the same reason."""


class Datagrams(Protocol):
    """Packets that may be lost, doubled, reordered."""

    @property
    def here(self) -> Endpoint: ...

    async def send(self, data: bytes, target: Endpoint | str) -> None:
        """Send to an endpoint, or to a node's address at the port of this priority. Failing to send is a loss."""
        ...

    async def receive(self) -> tuple[bytes, Endpoint]: ...

    async def aclose(self) -> None: ...


class Network(Protocol):
    """Connections and datagrams between nodes, and from clients to nodes. Clients only connect."""

    @property
    def turned_away(self) -> int:
        """Connections that were refused at the ports of this network since it was made: strangers', and what was too many."""
        ...

    async def listen(
        self,
        address: str,
        priority: Priority,
        serve: Serve,
        *,
        newcomers: ServeNewcomer | None = None,
        task_status: trio.TaskStatus[None] = trio.TASK_STATUS_IGNORED,
    ) -> None:
        """Serve connections to a node's address until cancelled; start it with `nursery.start`.

        `serve` runs once for each authenticated peer, in a task of its own; the connection is closed when it
        returns. Strangers never reach it and never hold up others. LocalFault if the port cannot be had.
        `newcomers` serves peers that have no certificate and say that they want one, a few at a time.
        """
        ...

    async def connect(self, address: str, priority: Priority) -> Connection:
        """Connect to the node at an address, and see that it is the node that it should be; else Unreachable.

        Also if no version of the protocol is common: then both sides say which ones they take.
        """
        ...

    async def approach(self, address: str, /) -> tuple[Connection, bytes]:
        """Connect to a node's port of high priority as a newcomer, who has no certificate; and the certificate (DER) that the node shows.

        Nobody has judged that one yet. Unreachable, or TurnedAway if the node takes no newcomers.
        """
        ...

    async def open_broadcasts(self) -> tuple[Datagrams, Sequence[Endpoint]]:
        """A socket that may send to everybody around, and by which endpoints it reaches their ports of high priority."""
        ...

    def show(self, certificate: bytes, /) -> None:
        """Show a newer certificate (PEM) for the same key from the next handshake on. LocalFault if it is unusable; then the older one stays."""
        ...

    async def open_datagrams(self, address: str | None, priority: Priority) -> Datagrams:
        """Datagrams at a node's own address and port; with None (clients) at any free port. LocalFault if taken."""
        ...

    async def hear_broadcasts(self, address: str, priority: Priority) -> Sequence[Datagrams]:
        """What is sent to everybody around a node's address; as many sockets as that takes, none where it cannot be had. They only hear."""
        ...


class DiskSpace(NamedTuple):
    """Bytes: `used` by live data, `reusable` inside the store's file, `free` and `total` of the file system."""

    used: int
    reusable: int
    free: int
    total: int


class ReadTransaction(Protocol):
    """One unchanging view of the tables. Memoryviews are valid until the transaction ends: copy what stays."""

    def get(self, table: str, key: bytes) -> memoryview | None: ...

    def keys(self, table: str, first: bytes, last: bytes, *, reverse: bool = False) -> Iterator[bytes]:
        """The keys first <= key <= last in byte order, without touching values; in reverse from `last` down."""
        ...

    def scan(self, table: str, first: bytes, last: bytes, *, reverse: bool = False) -> Iterator[tuple[bytes, memoryview]]:
        """The same with values."""
        ...

    def first(self, table: str, first: bytes, last: bytes) -> tuple[bytes, memoryview] | None:
        """The first one of `scan`, at some fifth of the cost; None if there is none."""
        ...


class WriteTransaction(ReadTransaction, Protocol):
    """A view that sees its own changes. Its memoryviews are valid until the next `put` or `delete` only."""

    def put(self, table: str, key: bytes, value: bytes) -> None: ...

    def delete(self, table: str, key: bytes) -> bool:
        """True if there was something to delete."""
        ...


class Environment(Protocol):
    """An open folder of ordered tables. Its calls block: make them in a worker. One writer, any number of readers."""

    def read(self) -> AbstractContextManager[ReadTransaction]: ...

    def update(self, change: Callable[[WriteTransaction], T]) -> T:
        """Run `change` in a transaction and return its result once everything in it is durable; all or nothing.

        `change` may run more than once (a full map grows and it starts anew), so it must have no effect outside.
        What it raises aborts the transaction. DiskFull and DiskFailed as they say. A thread with a view open must
        not call this: to make room, an update may have to wait until all views have ended.
        """
        ...

    def space(self) -> DiskSpace: ...

    def close(self) -> None:
        """Wait for running transactions, then close and release the folder."""
        ...


class Disk(Protocol):
    """Folders with ordered tables, each open in one process at a time."""

    def open(self, folder: Path, tables: Sequence[str], /) -> Environment:
        """Open a folder, made if need be. LocalFault if it is in use, no folder, unwritable or no store of ours."""
        ...


@dataclass(frozen=True, slots=True)
class World:
    """Everything outside of a node or a client, as values that can be replaced together."""

    clock: Clock
    entropy: Entropy
    workers: Workers
    network: Network
    disk: Disk
