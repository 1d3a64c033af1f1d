"""The newcomer's side of a connection without a certificate of its own (specs/15-cluster-log.md, Enrolling).

It knows the authority by a mark from its token only. So it says nothing before the other side has shown the authority's certificate
that has this mark, and has itself the certificate of a node that this authority issued.
"""

from __future__ import annotations

import os

import trio

from scenefold.base.errors import DamagedData, PeerFault, Refused, TurnedAway, Unreachable
from scenefold.base.ids import NodeId, address_of, node_id_of
from scenefold.base.limits import HANDSHAKE_S_MAX, NEWCOMER_S_MAX
from scenefold.base.printable import printable
from scenefold.crypto import Card, authority_pem, mark_of, newcomer_context, peer_certificate
from scenefold.wire import Fault, FrameReader, MalformedPacket, Packet, decode_packet, encode_frame
from scenefold.wire.enrol_packets import Enrolled, Greeting, RequestEnrolment
from scenefold.world.real.dialling import dial
from scenefold.world.real.tls import TlsStream, why_broken
from scenefold.world.versions import NEWCOMER

ANSWER_BYTES_MAX = 1024 * 1024
RECEIVE_BYTES = 64 * 1024


async def request_enrolment(node: NodeId, port: int, mark: bytes, request: RequestEnrolment) -> Enrolled:
    """Ask one node. Refused if the cluster says no, Unreachable if nobody answers, TurnedAway if it is a node of another cluster."""
    where = f"{address_of(node)}:{port}"
    try:
        with trio.fail_after(HANDSHAKE_S_MAX + NEWCOMER_S_MAX):
            return await _request(node, port, mark, request, where)
    except trio.TooSlowError:
        raise Unreachable("the node does not answer", where=where, remedy="see that it runs, then try again") from None
    except OSError as error:
        why = os.strerror(error.errno) if error.errno else str(error)
        raise Unreachable(f"no connection to the node: {why}", where=where, remedy="see that it runs there, then try again") from error
    except (trio.BrokenResourceError, trio.ClosedResourceError) as error:
        raise Unreachable(f"no connection to the node: {why_broken(error)}", where=where, remedy="try again later") from error
    except MalformedPacket as error:
        raise PeerFault(str(error), where=where) from error


async def _request(node: NodeId, port: int, mark: bytes, request: RequestEnrolment, where: str) -> Enrolled:
    stream = await dial(address_of(node), port)
    context = newcomer_context()
    context.set_alpn_protocols([NEWCOMER])
    secure: TlsStream = trio.SSLStream(stream, context, server_hostname=address_of(node))
    try:
        with trio.fail_after(HANDSHAKE_S_MAX):
            await secure.do_handshake()
            if secure.selected_alpn_protocol() != NEWCOMER:
                raise TurnedAway("the node takes no newcomers", where=where, remedy="update its program")
            frames = FrameReader(ANSWER_BYTES_MAX)
            greeting = await _next(secure, frames)
        _check_greeting(greeting, peer_certificate(secure), node, mark, where)
        await secure.send_all(encode_frame(request))
        answer = await _next(secure, frames)
        if isinstance(answer, Fault):
            raise Refused(answer.reason, printable(answer.text), where=where)
        if not isinstance(answer, Enrolled):
            raise PeerFault(f"a request to be enrolled was answered with a {type(answer).__name__}", where=where)
        return answer
    finally:
        # Nothing more is to be said, and nobody shall be waited for.
        await trio.aclose_forcefully(secure)


def _check_greeting(greeting: Packet, certificate: bytes, node: NodeId, mark: bytes, where: str) -> None:
    """TurnedAway unless this is that node of the cluster that the token is of."""
    another = TurnedAway("a node of another cluster answers there", where=where, remedy="ask for a token of this cluster")
    if not isinstance(greeting, Greeting):
        raise another
    try:
        if mark_of(greeting.authority) != mark:
            raise another
        card = Card.verified(certificate, authority_pem(greeting.authority))
    except DamagedData:
        raise another from None
    if card.name != f"node:{node}":
        raise TurnedAway(f"{card.name} answers there instead of node:{node}", where=where, remedy="see which computer has that address")


async def _next(secure: TlsStream, frames: FrameReader) -> Packet:
    while True:
        data = await secure.receive_some(RECEIVE_BYTES)
        if not data:
            raise trio.BrokenResourceError("the node closed the connection")
        if whole := frames.feed(bytes(data)):
            return decode_packet(whole[0])


async def own_address_towards(node: NodeId, port: int) -> NodeId:
    """By which address this computer reaches a node. Nothing is sent. Unreachable if it has no way there."""
    with trio.socket.socket(type=trio.socket.SOCK_DGRAM) as probe:
        try:
            await probe.connect((address_of(node), port))
        except OSError as error:
            why = os.strerror(error.errno) if error.errno else str(error)
            raise Unreachable(f"this computer has no way to the node: {why}", where=address_of(node), remedy="name --address") from error
        return node_id_of(str(probe.getsockname()[0]))
