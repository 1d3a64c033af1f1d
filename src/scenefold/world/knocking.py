"""How a newcomer finds nodes, and asks one of them for a certificate (specs/15-cluster-log.md, Enrolling).

It knows the authority by a mark from its token only. So it says nothing before the other side has shown the authority's certificate
that has this mark, and has itself the certificate of a node that this authority issued.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Container

import trio

from scenefold.base.errors import DamagedData, PeerFault, Refused, TurnedAway, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.base.limits import HANDSHAKE_S_MAX, NEWCOMER_S_MAX
from scenefold.base.printable import printable
from scenefold.crypto import Card, SigningKey, authority_pem, mark_of
from scenefold.wire import Fault, FrameReader, MalformedPacket, Packet, decode_packet, encode_frame
from scenefold.wire.enrol_packets import Enrolled, Greeting, RequestEnrolment
from scenefold.world.discovery import NONCE_BYTES, pack_question, read_answer
from scenefold.world.nearby import CHANCE_BYTES, Nearby
from scenefold.world.ports import Connection, ConnectionLost, Entropy, Network

ANSWER_BYTES_MAX = 1024 * 1024
RECEIVE_BYTES = 64 * 1024
ROUNDS = 3
ROUND_S = 1.0


async def request_enrolment(network: Network, node: NodeId, mark: bytes, request: Callable[[], Awaitable[RequestEnrolment]]) -> Enrolled:
    """Ask one node. The request is made once that has shown that it is one of the cluster. Refused if the cluster says no, Unreachable if nobody answers, TurnedAway if it is a node of another cluster."""
    where = address_of(node)
    try:
        with trio.fail_after(HANDSHAKE_S_MAX + NEWCOMER_S_MAX):
            connection, certificate = await network.approach(where)
            try:
                return await _asked(connection, certificate, node, mark, request)
            finally:
                await connection.aclose()
    except trio.TooSlowError:
        raise Unreachable("the node does not answer", where=where, remedy="see that it runs, then try again") from None
    except ConnectionLost as error:
        raise Unreachable(f"no connection to the node: {error}", where=where, remedy="try again later") from error
    except MalformedPacket as error:
        raise PeerFault(str(error), where=where) from error


async def _asked(
    connection: Connection, certificate: bytes, node: NodeId, mark: bytes, request: Callable[[], Awaitable[RequestEnrolment]]
) -> Enrolled:
    where, frames = address_of(node), FrameReader(ANSWER_BYTES_MAX)
    with trio.fail_after(HANDSHAKE_S_MAX):  # a node sends it unasked, so who is none holds up nobody for longer
        greeting = await _next(connection, frames)
    _check_greeting(greeting, certificate, node, mark)
    await connection.send(encode_frame(await request()))
    answer = await _next(connection, frames)
    if isinstance(answer, Fault):
        raise Refused(answer.reason, printable(answer.text), where=where)
    if not isinstance(answer, Enrolled):
        raise PeerFault(f"a request to be enrolled was answered with a {type(answer).__name__}", where=where)
    return answer


def _check_greeting(greeting: Packet, certificate: bytes, node: NodeId, mark: bytes) -> None:
    """TurnedAway unless this is that node of the cluster that the token is of."""
    where = address_of(node)
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


async def _next(connection: Connection, frames: FrameReader) -> Packet:
    while True:
        data = await connection.receive(RECEIVE_BYTES)
        if not data:
            raise ConnectionLost("the node closed the connection")
        if whole := frames.feed(data):
            return decode_packet(whole[0])


async def look_around(network: Network, key: SigningKey, entropy: Entropy, *, passed: Container[NodeId] = ()) -> list[NodeId]:
    """Nodes nearby that know the invitation with this key, so they say, but for those `passed` over. Empty if none answers within some seconds.

    Of the whole round in which the first of them answers: who is quick has no advantage.
    """
    nearby, nonce = Nearby(entropy.token(CHANCE_BYTES)), entropy.token(NONCE_BYTES)
    question, found = pack_question(key, nonce), list[NodeId]()
    datagrams, targets = await network.open_broadcasts()
    try:
        for _ in range(ROUNDS):
            for target in targets:
                await datagrams.send(question, target)
            with trio.move_on_after(ROUND_S):
                while True:
                    data, source = await datagrams.receive()
                    node = read_answer(data, nonce)
                    if node is not None and node not in passed:
                        nearby.hear(source.address, node)
            if found := nearby.chosen():
                break
    finally:
        with trio.CancelScope(shield=True):
            await datagrams.aclose()
    return found
