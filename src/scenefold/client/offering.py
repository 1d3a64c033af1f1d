"""Bringing a proposal to those who decide a scene's log, and what they make of it (specs/16-scene-log.md, Author).

The origin of a scene is asked by whichever way leads to it. Participants are asked one after the other, all authors beginning with the same
one, which puts what they ask for in a row: two that propose at once only hold each other up. What one of them cannot do another one
may; what it says of itself it says for nobody else.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

from scenefold.base.errors import Refused, ScenefoldError
from scenefold.base.ids import NodeId, address_of
from scenefold.base.limits import CLIENT_ASKED_MAX, CLIENT_DECIDE_NEXT_S, CLIENT_DECIDE_S
from scenefold.base.reasons import RejectReason
from scenefold.client.calls import Calls
from scenefold.client.doubt import Doubt
from scenefold.client.hedging import first_answer
from scenefold.client.offers import as_decided, check_answer
from scenefold.wire import AcceptSceneProposal, ProposeSceneLog, RejectSceneProposal, SceneLogPublic
from scenefold.world import Priority

_OTHERS_MAY = (
    RejectReason.BUSY,
    RejectReason.NOT_READY,
    RejectReason.PEER_MISSED,
    RejectReason.NO_MAJORITY,
    RejectReason.NOT_AUTHORISED,
    RejectReason.STORAGE_FULL,
    RejectReason.UNKNOWN_SCENE_OR_SPACE,
)
"""What a participant says of itself, and of what it can reach. Of several such answers the first of these is told: one that is cut off misses a
majority that another one may have, which is busy with a ballot of it, or waits for one more beside it."""
ROUND_MAX = 3
"""Participants that are asked in one round: a majority that is not there is missed by all of them, and each takes its time to say so."""


class Rejected(NamedTuple):
    """120, and who answered it; with PEER_MISSED who does not answer, and how long ago there was a sign of life of it, 0 if that is not known."""

    reason: RejectReason
    by: NodeId
    silent_ms: int = 0


async def offered(calls: Calls, packet: ProposeSceneLog, doubt: Doubt) -> SceneLogPublic | Rejected:
    """One round of asking for what the origin decides: the header as it was decided, or the reason of the origin, or of a node that cannot ask it."""
    numbers = [packet.public.position]
    answers = AcceptSceneProposal, RejectSceneProposal
    reply: AcceptSceneProposal | RejectSceneProposal = await calls.ask_around(
        packet,
        answers,
        first=packet.public.origin,
        around=lambda: doubt.trying(numbers),
        # Whatever comes out of this round has passed it.
        judged=partial(check_answer, packet),
    )
    return _outcome(packet, reply, doubt)


async def offered_to(calls: Calls, participants: Sequence[NodeId], packet: ProposeSceneLog, doubt: Doubt) -> SceneLogPublic | Rejected:
    """One round of asking participants, the next one while one says nothing: the header as it was decided, or why it was not."""
    numbers = [packet.public.position]
    rejections: list[Rejected] = []

    async def ask(node: NodeId) -> SceneLogPublic | Rejected:
        with doubt.trying(numbers):
            answers = AcceptSceneProposal, RejectSceneProposal
            reply: AcceptSceneProposal | RejectSceneProposal = await calls.ask(
                address_of(node), packet, answers, priority=Priority.HIGH, timeout_s=CLIENT_DECIDE_S
            )
            check_answer(packet, reply)
        outcome = _outcome(packet, reply, doubt)
        if isinstance(outcome, Rejected) and outcome.reason in _OTHERS_MAY:
            rejections.append(outcome)
            raise Refused(outcome.reason, "another participant may", where=address_of(node))
        return outcome

    tries = [partial(ask, node) for node in participants[:ROUND_MAX]]
    try:
        return await first_answer(tries, next_after_s=CLIENT_DECIDE_NEXT_S, at_a_time=CLIENT_ASKED_MAX, refusal_counts=False)
    except ScenefoldError:
        if not rejections:
            raise
    return min(rejections, key=lambda rejected: _OTHERS_MAY.index(rejected.reason))


def _outcome(packet: ProposeSceneLog, reply: AcceptSceneProposal | RejectSceneProposal, doubt: Doubt) -> SceneLogPublic | Rejected:
    if isinstance(reply, AcceptSceneProposal):
        return as_decided(packet, reply)
    if reply.reason == RejectReason.NOT_READY:
        doubt.note([packet.public.position])
    return Rejected(reply.reason, reply.node, reply.silent_ms)
