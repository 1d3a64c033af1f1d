"""Where clusters of tests live: addresses on 127.0.0.x, and ports that nobody takes before their nodes listen."""

from __future__ import annotations

import os
import random
import socket
from collections.abc import Iterable
from itertools import islice

from scenefold.world import Ports

# Below the range from which Linux picks ports for outgoing connections (ip_local_port_range), so that none of those
# takes a port between our look at it and the moment when a node listens.
FIRST, LAST = 12_000, 31_999
# `pytest -n` calls its processes gw0, gw1 and so on; each has a part of the range to itself.
PARTS = 16
ATTEMPTS = 1_000


def addresses(count: int) -> tuple[str, ...]:
    """Where the nodes of a local cluster listen."""
    return tuple(f"127.0.0.{2 + index}" for index in range(count))


def free_ports(at: Iterable[str] | None = None) -> Ports:
    """Two numbers that are free for TCP and UDP at all these addresses (by default nine of a local cluster)."""
    places = addresses(9) if at is None else tuple(at)
    part = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw")) % PARTS
    tried = random.sample(range(FIRST + part, LAST + 1, PARTS), ATTEMPTS)
    low, high = islice((number for number in tried if all(_is_free(place, number) for place in places)), 2)
    return Ports(low, high)


def ports_option(*at: str) -> str:
    """The same as the value of --ports."""
    ports = free_ports(at)
    return f"{ports.low},{ports.high}"


def _is_free(address: str, number: int) -> bool:
    for kind in (socket.SOCK_STREAM, socket.SOCK_DGRAM):
        with socket.socket(socket.AF_INET, kind) as probe:
            try:
                probe.bind((address, number))
            except OSError:
                return False
    return True
