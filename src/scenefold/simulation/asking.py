"""During the storm: can what a living owner holds be read of any node that can be reached? (specs/17-simulation.md, Laws)

Somebody of his own asks for places, every second for another one, of any member that runs. As long as the place's owner lives and
speaks for it, and nothing lies between it and the one that is asked, an answer must come within a time: whatever has
died, was cut off or lies elsewhere, and whatever those two were told by it before. What the owner has adopted, and has not learnt
of all members yet, waits for these: nobody needs to answer as long as one of them cannot say what it has.
"""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import SpaceId
from scenefold.base.location import Arc, Location
from scenefold.client.scene import Scene
from scenefold.peer import NodeContext
from scenefold.simulation import laws
from scenefold.simulation.cluster import Cluster, Node
from scenefold.simulation.lineage import Holder
from scenefold.wire import GetMany, GetManyReply, RecordKey
from scenefold.world import Links, Priority

ANSWER_S = 12.0
"""A status told to all and lost comes round by others within some seconds; a client with a table of its own is patient for more."""
LOOK_S = 0.5
"""Between two looks whether the owner still speaks for the place; every other time a new question begins."""
TRY_S_MAX = 11.0
"""A little more than a node gives another one to answer what it forwards."""
AGAIN_S = 0.5
QUESTIONS_MAX = 16


@dataclass(eq=False)
class Question:
    """Of one place, to one node in one of its lives. `owner`: whose the place is."""

    location: Location
    asked: Node
    owner: Node
    holder: Holder
    lives: tuple[object, object]
    since_s: float
    scope: trio.CancelScope = field(default_factory=trio.CancelScope)
    said: str = "nothing yet"


class Asker:
    """Asks until cancelled. `places`: what is asked for."""

    def __init__(self, cluster: Cluster, links: Links, scene: Scene, space: SpaceId, places: Sequence[Location]) -> None:
        self._cluster = cluster
        self._watch = cluster.watch
        self._links = links
        self._scene = scene
        self._space = space
        self._places = places
        self._dice = random.Random(f"asking/{cluster.net.seed}")
        self._open: list[Question] = []

    async def run(self) -> None:
        async with trio.open_nursery() as nursery:
            while True:
                question = self.draw()
                if question is not None and len(self._open) < QUESTIONS_MAX:
                    self._open.append(question)
                    nursery.start_soon(self._ask, question)
                for _ in range(2):
                    await trio.sleep(LOOK_S)
                    self._look()

    def draw(self) -> Question | None:
        """A question that must be answered, if it is one; else none."""
        members = [node for _, node in sorted(self._cluster.running.items()) if node.context is not None and node.context.joined.is_set()]
        location = self._dice.choice(self._places)
        asked = self._dice.choice(members) if members else None
        holder = self._watch.lineage.holder_of(location).holder
        owner = None if holder is None else self._cluster.running.get(holder.slot)
        if asked is None or holder is None or owner is None:
            return None
        question = Question(location, asked, owner, holder, (asked.context, owner.context), self._cluster.net.now)
        return question if self.must_be_answered(question) else None

    def must_be_answered(self, question: Question) -> bool:
        """Whether nothing has come between since the question was asked for the first time."""
        asked, owner = question.asked, question.owner
        piece = self._watch.lineage.holder_of(question.location)
        if piece.holder != question.holder or piece.released or (asked.context, owner.context) != question.lives:
            return False
        if owner.context is None or not owner.context.lease.holds() or not owner.owns(question.location):
            return False
        window = (question.since_s, self._cluster.net.now)
        return self._watch.reach.was_clear(asked.slot, owner.slot, window) and self._is_known(question, owner.context, window)

    def _is_known(self, question: Question, context: NodeContext, window: tuple[float, float]) -> bool:
        """Whether the owner knows what lies at the place, or nothing has come between it and any of those whom it has to hear."""
        copies, registry = context.line.parts.keeper.copies, context.cluster_log.registry
        if copies.is_recovered(Arc(question.location, question.location)):
            return True
        tellers = [self._cluster.running.get(self._cluster.slot_of(node)) for node in registry.members]
        return all(
            teller is not None
            and teller.context is not None
            and registry.is_current(teller.context.own.member)
            and teller.context.line.parts.arrival.is_done
            and self._watch.reach.was_clear(question.owner.slot, teller.slot, window)
            for teller in tellers
        )

    def _look(self) -> None:
        for question in list(self._open):
            if not self.must_be_answered(question):
                self._open.remove(question)
                question.scope.cancel()
            elif self._cluster.net.now - question.since_s >= ANSWER_S:
                self._open.remove(question)
                question.scope.cancel()
                self._complain(question)

    def _complain(self, question: Question) -> None:
        words = f"n{question.owner.slot} lives and owns a place that n{question.asked.slot} cannot have read for {ANSWER_S:g} s"
        self._watch.violated(
            laws.REACHED,
            f"{words}: {question.said}",
            location=question.location,
            slots=(question.asked.slot, question.owner.slot),
        )

    async def _ask(self, question: Question) -> None:
        identity = self._scene.access.identity
        packet = GetMany(identity.scene, identity.position, (RecordKey(self._space, question.location),))
        request = partial(self._links.request, question.asked.address, Priority.LOW, packet, TRY_S_MAX)
        with question.scope:
            while True:
                try:
                    answer = await request()
                    if isinstance(answer, GetManyReply):
                        self._watch.counts["answered in the storm"] += 1
                        self._open.remove(question)
                        return
                    question.said = f"it answers with {type(answer).__name__}"
                except (Unreachable, Refused, PeerFault) as problem:
                    question.said = str(problem)
                await trio.sleep(AGAIN_S)
