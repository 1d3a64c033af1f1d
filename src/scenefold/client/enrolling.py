"""`cluster join TOKEN`: from a token to a profile (specs/15-cluster-log.md, Enrolling)."""

from __future__ import annotations

import datetime
import socket
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

from scenefold.base.errors import DamagedData, PeerFault, Refused, ScenefoldError, TurnedAway, Unreachable, UsageFault
from scenefold.base.ids import NodeId, address_of
from scenefold.base.reasons import RejectReason
from scenefold.client.hedging import first_answer, more_telling
from scenefold.crypto import InvitedKind, Token
from scenefold.crypto.invitations import ADDRESSES_MAX
from scenefold.crypto.suites import DEFAULT_SUITE
from scenefold.wire.enrol_packets import Enrolled, RequestEnrolment
from scenefold.world import Ports, World, newcomer_world
from scenefold.world.knocking import look_around, request_enrolment
from scenefold.world.newcomer import SOMEWHERE, USER_AT, Newcomer
from scenefold.world.profile import ClusterProfile

LOOKS_MAX = 3
"""Looks around the local network, each of some seconds, as long as they bring nodes that were not asked yet."""
AT_ONCE = 4
NEXT_AFTER_S = 1.0
"""So many nodes are asked at once: the next one as soon as one has failed, or has said nothing for a while."""
WORDS_MAX = 160
"""Of each node that is told with its words, if there are several."""
_FINAL = frozenset({RejectReason.NOT_AUTHORISED, RejectReason.SIGNATURE_INVALID, RejectReason.KEY_REVOKED})
"""Reasons of who has judged the request; others may be those of a relay behind which a trusted node has certified it."""


class Admitted(NamedTuple):
    """By whom, with which answer, as what."""

    by: NodeId
    answer: Enrolled
    newcomer: Newcomer


async def enrol(
    profile: Path, token: Token, node: NodeId = USER_AT, *, suite: int = DEFAULT_SUITE, world: World | None = None
) -> ClusterProfile:
    """Make keys for a user, or for a node at its address, and have them certified; the profile, with those keys in it.

    Errors: UsageFault if the token is for the other kind, Refused in the cluster's words, Unreachable if no node answers, OutOfDate if this
    computer's clock is wrong; whatever it was, the same token may be tried again here.
    """
    return (await _enrolled(profile, token, node, suite, world))[0]


async def enrol_here(profile: Path, token: Token, *, world: World | None = None) -> tuple[ClusterProfile, NodeId]:
    """The same for a node at that address of this computer by which it reaches the node that takes it; and that address.

    Not by which it reaches any that was found: a liar that names an address far away would choose under which one the token is used up.
    """
    return await _enrolled(profile, token, SOMEWHERE, DEFAULT_SUITE, world)


async def _enrolled(profile: Path, token: Token, node: NodeId, suite: int, world: World | None) -> tuple[ClusterProfile, NodeId]:
    if (token.kind is InvitedKind.USER) != (node == USER_AT):
        what, remedy = ("user", "leave --address out") if token.kind is InvitedKind.USER else ("node", "run it on the node's computer")
        raise UsageFault(f"the token is for a {what}", where="token", remedy=remedy)
    world = world or newcomer_world(Ports(token.low, token.high))
    near = token.addresses or await _nearby(token, world)
    if not near:
        remedy = "connect this computer to the network of the nodes, or ask for a token that names nodes"
        raise Unreachable("no node of the cluster answers on the local network, and the token names none", where="broadcast", remedy=remedy)
    newcomer = await world.workers.run("import", lambda: Newcomer.at(profile, token, node, suite=suite))
    now = datetime.datetime.fromtimestamp(world.clock.wall(), datetime.UTC)
    asking = _Asking(world, newcomer, now)
    admitted = await asking.of(near)
    looks = 0
    # Whom the token names speaks for the cluster. Who was only found here may be anybody, and have answered first on purpose.
    while admitted is None and looks < LOOKS_MAX and not (token.addresses and asking.is_refused_by(token.addresses)):
        looks += 1
        found = await _nearby(token, world, asking.asked)
        if not found:
            break
        admitted = await asking.of(found)
    if admitted is None:
        if asking.is_final():
            await world.workers.run("import", newcomer.forget)
        raise asking.error()
    # Where to look for the cluster from now on: not where liars are.
    first = dict.fromkeys((admitted.by, *token.addresses))
    newcomer = replace(admitted.newcomer, token=replace(token, addresses=tuple(first)[:ADDRESSES_MAX]))
    return await world.workers.run("import", newcomer.admitted, admitted.answer, now), newcomer.node


async def own_address(node: NodeId, token: Token) -> NodeId:
    """By which address this computer reaches a node of a token's cluster."""
    from scenefold.world.real.newcomers import own_address_towards

    return await own_address_towards(node, token.high)


def check_is_here(node: NodeId, high: int) -> None:
    """LocalFault if this computer does not have that address: a token that is used for it serves nobody."""
    from scenefold.world.real.binding import bind_fault

    where = address_of(node)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind((where, 0))
        except OSError as problem:
            raise bind_fault(problem, "UDP", where, high) from problem


async def _nearby(token: Token, world: World, asked: Sequence[NodeId] = ()) -> list[NodeId]:
    return await look_around(world.network, token.key, world.entropy, passed=asked)


class _NoneToBelieve(Unreachable):
    """Why, was noted: the next node is asked."""


class _Asking:
    """What nodes say to a newcomer: a node that lies, or errs, speaks for itself only."""

    def __init__(self, world: World, newcomer: Newcomer, now: datetime.datetime) -> None:
        self._world, self._newcomer, self._now = world, newcomer, now
        self.asked: list[NodeId] = []
        self._told: list[NodeId] = []
        """Those of them to which the request went."""
        self._refusals: dict[NodeId, Refused | DamagedData] = {}
        self._last: Unreachable | PeerFault | Refused | None = None

    def is_refused_by(self, nodes: Sequence[NodeId]) -> bool:
        """Whether one of these said no, or what is not to be believed."""
        return any(node in self._refusals for node in nodes)

    async def of(self, nodes: Sequence[NodeId]) -> Admitted | None:
        """The first answer that is to be believed; None if none of those gives one that were not asked before.

        A few are asked at once, since most may be there only to be waited for. It is the same request under the same keys, so whichever
        nodes take it, one certificate is issued.
        """
        fresh = [node for node in dict.fromkeys(nodes) if node != self._newcomer.node and node not in self.asked]
        if not fresh:
            return None
        try:
            return await first_answer([partial(self._of, node) for node in fresh], next_after_s=NEXT_AFTER_S, at_a_time=AT_ONCE)
        except _NoneToBelieve:
            return None

    async def _of(self, node: NodeId) -> Admitted:
        newcomer = self._newcomer
        self.asked.append(node)

        async def request() -> RequestEnrolment:
            nonlocal newcomer
            if newcomer.node == SOMEWHERE:
                newcomer = replace(newcomer, node=await own_address(node, newcomer.token))
                if newcomer.node == node:
                    raise Unreachable("that node runs on this computer", where=address_of(node), remedy="name another --address")
            self._told.append(node)
            return newcomer.request()

        try:
            answer = await request_enrolment(self._world.network, node, newcomer.token.mark, request)
            newcomer.check(answer, self._now)
        except Unreachable as problem:
            self._last = more_telling(self._last, problem) if isinstance(self._last, Unreachable) else problem
        except PeerFault as problem:
            self._last = self._last if isinstance(self._last, Unreachable) else problem
        except (Refused, DamagedData) as refusal:
            if isinstance(refusal, Refused) and refusal.reason is RejectReason.NOT_READY:
                self._last = refusal
            else:
                self._refusals[node] = refusal
        else:
            return Admitted(node, answer, newcomer)
        raise _NoneToBelieve("", where=address_of(node))

    def is_final(self) -> bool:
        """Whether no node can have certified the newcomer's keys: all that were given them have judged them and said no.

        Of an earlier try, whose answer was lost, none of them can say that: whoever certified the keys then may have been found by
        chance, and who refuses them now may not have heard of it.
        """
        final = {node for node, no in self._refusals.items() if isinstance(no, Refused) and no.reason in _FINAL}
        return not self._newcomer.asked_before and final.issuperset(self._told)

    def error(self) -> ScenefoldError:
        """Why none admits the newcomer: what each of those said that turned it down; Unreachable, in the words of the last, if none answers."""
        if self._refusals:
            return _told(self._refusals)
        last = self._last
        why = "" if last is None else f": {last.what.removeprefix('no connection to the node: ')}"
        where = ", ".join(map(address_of, self.asked))
        remedy = (last.remedy if last is not None else "") or "see that one of them runs, then try again"
        kind = TurnedAway if isinstance(last, TurnedAway) else Unreachable
        return kind(f"no node of the cluster takes the token{why}", where=where, remedy=remedy)


def _told(refusals: Mapping[NodeId, Refused | DamagedData]) -> Refused | DamagedData:
    """The first of these, which says who said what."""
    first = next(iter(refusals.values()))
    by_words: dict[str, list[str]] = {}
    for node, refusal in refusals.items():
        by_words.setdefault(refusal.what[:WORDS_MAX], []).append(address_of(node))
    if len(by_words) > 1:
        first.what = "the nodes turned the token down: " + "; ".join(f"{', '.join(said)}: {words}" for words, said in by_words.items())
        first.where = ""
    else:
        first.where = ", ".join(map(address_of, refusals))
    return first
