"""The newcomer's side of the network, which has no certificate of its own (specs/15-cluster-log.md, Enrolling)."""

from __future__ import annotations

import os

import trio

from scenefold.base.errors import TurnedAway, Unreachable
from scenefold.base.ids import NodeId, address_of, node_id_of
from scenefold.base.limits import HANDSHAKE_S_MAX
from scenefold.crypto import newcomer_context, peer_certificate
from scenefold.world.ports import Endpoint, Ports, Priority
from scenefold.world.real.broadcasts import open_broadcasts
from scenefold.world.real.datagrams import RealDatagrams
from scenefold.world.real.dialling import dial
from scenefold.world.real.offline import NoNetwork
from scenefold.world.real.tls import Lumps, TlsConnection, TlsStream, why_broken
from scenefold.world.versions import NEWCOMER, TAKEN


class NewcomerNetwork(NoNetwork):
    """Who has no identity yet can ask for one, and nothing else."""

    def __init__(self, ports: Ports) -> None:
        self._ports = ports

    async def approach(self, address: str) -> tuple[TlsConnection, bytes]:
        return await approach(address, self._ports.number(Priority.HIGH))

    async def open_broadcasts(self) -> tuple[RealDatagrams, tuple[Endpoint, ...]]:
        return await open_broadcasts(self._ports.number(Priority.HIGH))


async def approach(address: str, port: int) -> tuple[TlsConnection, bytes]:
    """A connection without a certificate, and the one that the node shows, which nobody has judged yet."""
    where = f"{address}:{port}"
    try:
        with trio.fail_after(HANDSHAKE_S_MAX):
            return await _shaken(address, port, where)
    except trio.TooSlowError:
        raise Unreachable("the node does not answer", where=where, remedy="see that it runs, then try again") from None
    except OSError as error:
        why = os.strerror(error.errno) if error.errno else str(error)
        raise Unreachable(f"no connection to the node: {why}", where=where, remedy="see that it runs there, then try again") from error
    except (trio.BrokenResourceError, trio.ClosedResourceError) as error:
        raise Unreachable(f"no connection to the node: {why_broken(error)}", where=where, remedy="try again later") from error


async def _shaken(address: str, port: int, where: str) -> tuple[TlsConnection, bytes]:
    stream = await dial(address, port)
    context = newcomer_context()
    context.set_alpn_protocols([NEWCOMER])
    secure: TlsStream = trio.SSLStream(Lumps(stream), context, server_hostname=address)
    try:
        await secure.do_handshake()
        if secure.selected_alpn_protocol() != NEWCOMER:
            raise TurnedAway("the node takes no newcomers", where=where, remedy="update its program")
        return TlsConnection(secure, "", TAKEN.highest), peer_certificate(secure)
    except BaseException:
        await trio.aclose_forcefully(secure)
        raise


async def own_address_towards(node: NodeId, port: int) -> NodeId:
    """By which address this computer reaches a node. Nothing is sent. Unreachable if it has no way there."""
    with trio.socket.socket(type=trio.socket.SOCK_DGRAM) as probe:
        try:
            await probe.connect((address_of(node), port))
        except OSError as error:
            why = os.strerror(error.errno) if error.errno else str(error)
            raise Unreachable(f"this computer has no way to the node: {why}", where=address_of(node), remedy="name --address") from error
        return node_id_of(str(probe.getsockname()[0]))
