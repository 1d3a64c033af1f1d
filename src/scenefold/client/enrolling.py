"""`cluster join TOKEN`: from a token to a profile (specs/15-cluster-log.md, Enrolling)."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from scenefold.base.errors import DamagedData, PeerFault, Refused, TurnedAway, Unreachable, UsageFault
from scenefold.base.ids import NodeId, address_of
from scenefold.base.reasons import RejectReason
from scenefold.client.hedging import more_telling
from scenefold.crypto import InvitedKind, Token
from scenefold.crypto.invitations import ADDRESSES_MAX
from scenefold.crypto.suites import DEFAULT_SUITE
from scenefold.wire.enrol_packets import Enrolled
from scenefold.world import Ports, World, newcomer_world
from scenefold.world.discovery import NONCE_BYTES
from scenefold.world.knocking import look_around, request_enrolment
from scenefold.world.newcomer import USER_AT, Newcomer
from scenefold.world.profile import ClusterProfile


async def enrol(
    profile: Path, token: Token, node: NodeId = USER_AT, *, suite: int = DEFAULT_SUITE, world: World | None = None
) -> ClusterProfile:
    """Make keys for a user, or for a node at its address, and have them certified; the profile, with those keys in it.

    Errors: UsageFault if the token is for the other kind, Refused in the cluster's words, Unreachable if no node answers, OutOfDate if this
    computer's clock is wrong; whatever it was, the same token may be tried again here.
    """
    if (token.kind is InvitedKind.USER) != (node == USER_AT):
        what, remedy = ("user", "leave --address out") if token.kind is InvitedKind.USER else ("node", "run it on the node's computer")
        raise UsageFault(f"the token is for a {what}", where="token", remedy=remedy)
    world = world or _world_of(token)
    token = await located(token, world)
    newcomer = await world.workers.run("import", lambda: Newcomer.at(profile, token, node, suite=suite))
    now = datetime.datetime.fromtimestamp(world.clock.wall(), datetime.UTC)
    try:
        answer = await _ask(world, newcomer, token.addresses, now)
    except Unreachable:
        # Those that the token names may be gone, and others be near.
        nearby = tuple(address for address in await _nearby(token, world) if address not in token.addresses)
        if not nearby:
            raise
        answer = await _ask(world, newcomer, nearby, now)
    return await world.workers.run("import", newcomer.admitted, answer, now)


async def located(token: Token, world: World | None = None) -> Token:
    """The token with addresses of nodes: its own, or those that answer on the local network. Unreachable if there are none."""
    if token.addresses:
        return token
    nearby = await _nearby(token, world or _world_of(token))
    if not nearby:
        remedy = "connect this computer to the network of the nodes, or ask for a token that names nodes"
        raise Unreachable("no node of the cluster answers on the local network, and the token names none", where="broadcast", remedy=remedy)
    return replace(token, addresses=tuple(nearby[:ADDRESSES_MAX]))


async def own_address(token: Token) -> NodeId:
    """By which address this computer reaches the cluster of a token that names nodes."""
    from scenefold.world.real.newcomers import own_address_towards

    return await own_address_towards(token.addresses[0], token.high)


async def _nearby(token: Token, world: World) -> list[NodeId]:
    return await look_around(world.network, token.key, world.entropy.token(NONCE_BYTES))


def _world_of(token: Token) -> World:
    return newcomer_world(Ports(token.low, token.high))


async def _ask(world: World, newcomer: Newcomer, addresses: Sequence[NodeId], now: datetime.datetime) -> Enrolled:
    """The first answer that is to be believed: a node that lies, or errs, speaks for itself only.

    Else what the first refusal, or answer that is not believed, said; Unreachable, in the words of the last, if none of them answers.
    """
    token = newcomer.token
    first: Refused | DamagedData | None = None
    last: Unreachable | PeerFault | Refused | None = None
    for address in addresses:
        if address == newcomer.node:
            continue
        try:
            answer = await request_enrolment(world.network, address, token.mark, newcomer.request())
            newcomer.check(answer, now)
            return answer
        except Unreachable as problem:
            last = more_telling(last, problem) if isinstance(last, Unreachable) else problem
        except PeerFault as problem:
            last = last if isinstance(last, Unreachable) else problem
        except (Refused, DamagedData) as refusal:
            if isinstance(refusal, Refused) and refusal.reason is RejectReason.NOT_READY:
                last = refusal
            else:
                first = first or refusal
    if first is not None:
        raise first
    why = "" if last is None else f": {last.what.removeprefix('no connection to the node: ')}"
    where = ", ".join(map(address_of, addresses))
    remedy = (last.remedy if last is not None else "") or "see that one of them runs, then try again"
    kind = TurnedAway if isinstance(last, TurnedAway) else Unreachable
    raise kind(f"no node of the cluster takes the token{why}", where=where, remedy=remedy)
