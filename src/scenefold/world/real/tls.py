"""TLS connections over TCP (port `Connection`).

Trio encrypts on its own thread. So that a frame of 8 MiB never holds it for long, data goes in pieces, with a
chance for other tasks between any two; but in no smaller ones, since each costs a step of a task, and calls of the system.
"""

from __future__ import annotations

import socket
import ssl
import time

import trio

from scenefold.base.errors import DamagedData
from scenefold.base.ids import KeyId
from scenefold.crypto import peer_key, peer_name
from scenefold.world.ports import ConnectionLost, HandshakeRefused
from scenefold.world.versions import NEWCOMER, RANGE_BYTES, NoCommonVersion, Versions

SEND_PIECE_BYTES = RECEIVE_BYTES = 256 * 1024
CLOSE_S_MAX = 1.0

_OF_DATES = (9, 10)
"""OpenSSL's numbers for a certificate that is not valid yet, or no longer."""
_CUT = (ssl.SSLEOFError, ssl.SSLZeroReturnError, ssl.SSLSyscallError)


class Lumps(trio.abc.Stream):
    """A TCP connection that takes and gives as much at once as it is handed, or has here."""

    def __init__(self, stream: trio.SocketStream) -> None:
        self._stream = stream
        # Trio would have the kernel take 16 KiB at a time.
        stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, SEND_PIECE_BYTES)

    async def receive_some(self, count_max: int | None = None) -> bytes:
        return await self._stream.receive_some(count_max or RECEIVE_BYTES)

    async def send_all(self, data: bytes | bytearray | memoryview) -> None:
        await self._stream.send_all(data)

    async def wait_send_all_might_not_block(self) -> None:
        await self._stream.wait_send_all_might_not_block()

    async def aclose(self) -> None:
        await self._stream.aclose()


TlsStream = trio.SSLStream[Lumps]


class TlsConnection:
    """A connection whose handshake has ended."""

    def __init__(self, stream: TlsStream, peer: str, version: int, peer_key: KeyId | None = None) -> None:
        self._stream = stream
        self.peer = peer
        self.peer_key = peer_key
        self.version = version

    async def send(self, data: bytes | memoryview) -> None:
        view = memoryview(data)
        try:
            for start in range(0, len(view), SEND_PIECE_BYTES):
                await self._stream.send_all(view[start : start + SEND_PIECE_BYTES])
        except (trio.BrokenResourceError, trio.ClosedResourceError) as error:
            raise ConnectionLost(why_broken(error)) from error

    async def receive(self, count_max: int) -> bytes:
        try:
            return bytes(await self._stream.receive_some(count_max))
        except (trio.BrokenResourceError, trio.ClosedResourceError) as error:
            raise ConnectionLost(why_broken(error)) from error

    async def aclose(self) -> None:
        # A peer that reads nothing must not keep us from closing: after a second the socket is closed hard. The
        # shield lets a cancelled task still tell its peer that this is an orderly end.
        with trio.move_on_after(CLOSE_S_MAX, shield=True):
            try:
                await self._stream.aclose()
            except trio.BrokenResourceError:
                return
        await trio.lowlevel.checkpoint()


async def shake_hands(
    stream: trio.SocketStream, context: ssl.SSLContext, versions: Versions, *, dialled: str | None = None
) -> TlsConnection:
    """The handshake on a fresh TCP stream; the caller bounds its time, and closes the stream if this raises.

    `dialled` is the address that we connected to, which the peer's certificate must contain; None on the side that
    accepts. `context` offers the names of `versions`. Who says that it is a newcomer gets a connection without a name.

    ConnectionLost if the peer cuts it, HandshakeRefused if it shows no certificate of our authority, or is not content with
    ours; PeerFault if it names no one; NoCommonVersion.
    """
    stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    stream.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    secure: TlsStream = trio.SSLStream(Lumps(stream), context, server_hostname=dialled, server_side=dialled is None)
    try:
        await secure.do_handshake()
    except trio.BrokenResourceError as error:
        lost = HandshakeRefused if _is_of_tls(_first_cause(error)) else ConnectionLost
        raise lost(why_broken(error)) from error
    name = secure.selected_alpn_protocol()
    if dialled is None and name == NEWCOMER:
        return TlsConnection(secure, "", versions.highest)
    peer = peer_name(secure)
    if name is None:
        raise versions.apart_from_nothing(peer)
    version = versions.named(name)
    if version is None:
        raise await _apart(secure, peer, versions)
    return TlsConnection(secure, peer, version, peer_key(secure))


async def _apart(secure: TlsStream, peer: str, ours: Versions) -> NoCommonVersion:
    """Tell each other what we take."""
    data = b""
    try:
        await secure.send_all(ours.pack())
        while len(data) < RANGE_BYTES and (more := await secure.receive_some(RANGE_BYTES - len(data))):
            data += more
        return ours.apart_from(Versions.unpack(data), peer)
    except trio.BrokenResourceError as error:
        raise ConnectionLost(why_broken(error)) from error
    except DamagedData:
        return ours.apart_from_nothing(peer)


def why_broken(error: Exception) -> str:
    """What happened to a connection, in words, from the chain of causes that Trio and ssl leave."""
    cause = _first_cause(error)
    if isinstance(cause, ssl.SSLCertVerificationError):
        clock = f" (this clock says {time.strftime('%Y-%m-%d', time.gmtime())})" if cause.verify_code in _OF_DATES else ""
        return f"its certificate is not valid here: {cause.verify_message}{clock}"
    if isinstance(cause, _CUT):
        return "the connection was cut"
    if isinstance(cause, ssl.SSLError):
        return f"TLS failed: {(cause.reason or str(cause)).replace('_', ' ').lower()}"
    if isinstance(cause, OSError):
        return f"the connection failed: {cause.strerror or cause}"
    return "the connection is closed" if isinstance(cause, trio.ClosedResourceError) else "the connection was cut"


def _is_of_tls(cause: BaseException) -> bool:
    """Whether TLS itself forbids the connection, and nobody cut it."""
    return isinstance(cause, ssl.SSLError) and not isinstance(cause, _CUT)


def _first_cause(error: BaseException) -> BaseException:
    while error.__cause__ is not None:
        error = error.__cause__
    return error
