"""A node answers who looks for its cluster with the key of an invitation (specs/15-cluster-log.md, Enrolling).

Everybody on the local network can send these datagrams, so they are cheap to drop: by size and magic, by an invitation that the log does
not know, by the rate; only what is left has its signature verified. Who has overheard a question can send it again: a question is
answered a few times only, and an address, and an invitation, gets no more than a share of the answers.
"""

from __future__ import annotations

import logging
from collections import OrderedDict

import trio

from scenefold.base.ids import NodeId
from scenefold.peer.cluster_log.cluster_log import ClusterLog
from scenefold.world import Priority, QuietLog, World
from scenefold.world.buckets import Buckets
from scenefold.world.discovery import Question, pack_answer, read_question
from scenefold.world.facts import ClusterFacts
from scenefold.world.ports import Datagrams, Endpoint
from scenefold.world.roll import InvitationState
from scenefold.world.surviving import surviving

ANSWERS_PER_S_MAX = 30
CHECKS_PER_S_MAX = 100
"""Signatures that are verified: more than answers, so that questions with wrong ones take none away. A hundredth of a processor."""

CHECKS_OF_SOURCE, CHECKS_OF_SOURCE_PER_S = 20, 10.0
ANSWERS_TO_SOURCE, ANSWERS_TO_SOURCE_PER_S = 6, 3.0
ANSWERS_OF_INVITATION, ANSWERS_OF_INVITATION_PER_S = 12, 6.0
ANSWERS_OF_QUESTION = 9
"""A newcomer asks three times, by up to three broadcast addresses that a node may hear."""
QUESTIONS_KEPT = 1_024

_log = logging.getLogger("scenefold.peer.enrolment.discovery")


class Allowance:
    """So many a second, and no more."""

    def __init__(self, per_second: int) -> None:
        self._per_second = per_second
        self._second = -1
        self._left = 0

    def take(self, now: float) -> bool:
        if int(now) != self._second:
            self._second, self._left = int(now), self._per_second
        self._left -= 1
        return self._left >= 0


class Discovery:
    """Hears broadcasts, and answers few of them."""

    def __init__(self, world: World, facts: ClusterFacts, me: NodeId, address: str, cluster_log: ClusterLog) -> None:
        self._world = world
        self._facts = facts
        self._me = me
        self._address = address
        self._cluster_log = cluster_log
        self._checks, self._answers = Allowance(CHECKS_PER_S_MAX), Allowance(ANSWERS_PER_S_MAX)
        self._checks_of = Buckets(CHECKS_OF_SOURCE, CHECKS_OF_SOURCE_PER_S)
        self._answers_to = Buckets(ANSWERS_TO_SOURCE, ANSWERS_TO_SOURCE_PER_S)
        self._answers_of = Buckets(ANSWERS_OF_INVITATION, ANSWERS_OF_INVITATION_PER_S)
        self._answered: OrderedDict[Question, int] = OrderedDict()
        # Other clusters look for their nodes, too: nothing to warn of. What is not said is counted.
        self._quiet = QuietLog(_log, logging.INFO)
        self.dropped = 0
        """Broadcasts that were not answered."""

    async def run(self) -> None:
        """Answer until cancelled; at once over where nobody can be enrolled, or no broadcast is heard."""
        if not self._facts.authority:
            return
        heard = await self._world.network.hear_broadcasts(self._address, Priority.HIGH)
        if not heard:
            return
        # What is bound to a broadcast address cannot send.
        speaker: Datagrams | None = None
        try:
            speaker = await self._world.network.open_datagrams(None, Priority.HIGH)
            async with trio.open_nursery() as nursery:
                for datagrams in heard:
                    nursery.start_soon(self._listen, datagrams, speaker)
        finally:
            with trio.CancelScope(shield=True):
                for datagrams in (*heard, *([] if speaker is None else [speaker])):
                    await datagrams.aclose()

    async def _listen(self, datagrams: Datagrams, speaker: Datagrams) -> None:
        while True:
            data, source = await datagrams.receive()
            with surviving(self._quiet, self._world.clock.now(), source.address):
                await self._hear(data, source, speaker)

    async def _hear(self, data: bytes, source: Endpoint, speaker: Datagrams) -> None:
        question = read_question(data)
        why_not = "it is no question" if question is None else self.why_not(question, source.address)
        if question is None or why_not:
            self.dropped += 1
            self._quiet.say(self._world.clock.now(), source.address, "broadcast", f"a broadcast is not answered: {why_not}")
            return
        await speaker.send(pack_answer(question.nonce, self._me), source)

    def why_not(self, question: Question, source: str) -> str:
        """Empty if somebody holds an invitation of this cluster, and is to be answered now."""
        clock = self._world.clock
        invitation = self._cluster_log.registry.roll.invitations.get(question.invitation)
        # One that was used may be that of a newcomer who has not heard the answer.
        if invitation is None or invitation.state is InvitationState.WITHDRAWN or clock.wall() > invitation.entry.expires:
            return "no invitation that counts"
        now = clock.now()
        times = self._answered.get(question, 0)
        if times >= ANSWERS_OF_QUESTION:
            return "it was answered often enough"
        if not times:
            if not self._checks_of.take(source, now) or not self._checks.take(now):
                return "too many ask"
            if not question.is_signed():
                return "the signature is wrong"
        if (
            not self._answers_to.take(source, now)
            or not self._answers_of.take(question.invitation.hex(), now)
            or not self._answers.take(now)
        ):
            return "too many were answered"
        self._answered[question] = times + 1
        self._answered.move_to_end(question)
        if len(self._answered) > QUESTIONS_KEPT:
            self._answered.popitem(last=False)
        return ""
