"""`cluster join TOKEN`: from a token to a profile (specs/15-cluster-log.md, Enrolling)."""

from __future__ import annotations

import datetime
from pathlib import Path

from scenefold.base.errors import PeerFault, Refused, ScenefoldError, Unreachable, UsageFault
from scenefold.base.ids import NodeId, address_of
from scenefold.base.reasons import RejectReason
from scenefold.crypto import InvitedKind, Token
from scenefold.crypto.suites import DEFAULT_SUITE
from scenefold.world import offline_world
from scenefold.world.newcomer import USER_AT, Newcomer
from scenefold.world.profile import ClusterProfile


async def enrol(profile: Path, token: Token, node: NodeId = USER_AT, *, suite: int = DEFAULT_SUITE) -> ClusterProfile:
    """Make keys for a user, or for a node at its address, and have them certified; the profile, with those keys in it.

    Errors: UsageFault if the token is for the other kind, Refused in the cluster's words, Unreachable if no node answers, OutOfDate if this
    computer's clock is wrong; whatever it was, the same token may be tried again here.
    """
    from scenefold.world.real.newcomers import request_enrolment

    if (token.kind is InvitedKind.USER) != (node == USER_AT):
        what, remedy = ("user", "leave --address out") if token.kind is InvitedKind.USER else ("node", "run it on the node's computer")
        raise UsageFault(f"the token is for a {what}", where="token", remedy=remedy)
    world = offline_world()
    newcomer = await world.workers.run("import", lambda: Newcomer.at(profile, token, node, suite=suite))
    last: ScenefoldError | None = None
    addresses = [address for address in token.addresses if address != node]
    for address in addresses:
        try:
            answer = await request_enrolment(address, token.high, token.mark, newcomer.request())
        except (Unreachable, PeerFault) as problem:
            last = problem
            continue
        except Refused as refusal:
            if refusal.reason is not RejectReason.NOT_READY:
                raise
            last = refusal
            continue
        now = datetime.datetime.fromtimestamp(world.clock.wall(), datetime.UTC)
        return await world.workers.run("import", newcomer.admitted, answer, now)
    raise _nobody(addresses, last)


def _nobody(addresses: list[NodeId], last: ScenefoldError | None) -> ScenefoldError:
    if last is not None and len(addresses) == 1:
        return last
    where = ", ".join(map(address_of, addresses)) or "token"
    why = f": {last.what}" if last is not None else ", for the token names none"
    return Unreachable(f"no node of the cluster answers{why}", where=where, remedy="see that one of them runs, then try again")


async def own_address(token: Token) -> NodeId:
    """By which address this computer reaches the cluster of a token."""
    from scenefold.world.real.newcomers import own_address_towards

    if not token.addresses:
        raise UsageFault("the token names no node", where="token", remedy="name this computer's own --address")
    return await own_address_towards(token.addresses[0], token.high)
