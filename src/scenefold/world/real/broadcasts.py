"""Broadcasts on the local network: nodes hear them, newcomers send them (specs/15-cluster-log.md, Enrolling).

A socket that is bound to an address hears no broadcast, so nodes bind further ones to the broadcast addresses. Which of them exist is
the system's business: one that cannot be had is passed over, and then nobody is found by it.
"""

from __future__ import annotations

import ipaddress
import logging
import socket as plain

import trio

from scenefold.world.ports import Endpoint
from scenefold.world.real.datagrams import RealDatagrams, udp_socket

EVERYWHERE = "255.255.255.255"
LOOPBACK = "127.255.255.255"
_PREFIX = 24
"""Local networks have nearly always 256 addresses; where it is otherwise, EVERYWHERE does."""
_NOWHERE = ("192.0.2.1", 9)
"""An address for examples: only the way there is asked for, nothing is sent."""

_log = logging.getLogger("scenefold.world.broadcasts")


def broadcasts_of(address: str) -> tuple[str, ...]:
    """The broadcast addresses that reach a machine with this address."""
    if ipaddress.IPv4Address(address).is_loopback:
        return (LOOPBACK,)
    network = ipaddress.IPv4Network(f"{address}/{_PREFIX}", strict=False)
    return (EVERYWHERE, str(network.broadcast_address))


async def hear_broadcasts(address: str, port: int) -> tuple[RealDatagrams, ...]:
    """Sockets that hear what is sent to everybody around a node's address; several nodes of one machine may."""
    await trio.lowlevel.checkpoint()
    heard = []
    for broadcast in broadcasts_of(address):
        socket = udp_socket()
        socket.setsockopt(plain.SOL_SOCKET, plain.SO_REUSEADDR, 1)
        try:
            socket.bind((broadcast, port))
        except OSError as error:
            _log.info("broadcasts to %s:%d are not heard: %s", broadcast, port, error)
            socket.close()
            continue
        heard.append(RealDatagrams(socket, port))
    return tuple(heard)


async def open_broadcasts(port: int) -> tuple[RealDatagrams, tuple[Endpoint, ...]]:
    """A socket at any free port that may broadcast, and where to send to reach nodes at their port."""
    socket = udp_socket()
    try:
        socket.setsockopt(plain.SOL_SOCKET, plain.SO_BROADCAST, 1)
        socket.bind(("", 0))
        targets = dict.fromkeys((EVERYWHERE, *broadcasts_of(await _own_address()), LOOPBACK))
    except BaseException:
        socket.close()
        raise
    return RealDatagrams(socket, port), tuple(Endpoint(target, port) for target in targets)


async def _own_address() -> str:
    """The address by which this machine reaches the world; that of loopback if it does not."""
    with trio.socket.socket(trio.socket.AF_INET, trio.socket.SOCK_DGRAM) as probe:
        try:
            await probe.connect(_NOWHERE)
        except OSError:
            return "127.0.0.1"
        return str(probe.getsockname()[0])
