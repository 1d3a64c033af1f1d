"""A lying node that stores what a client's record does not allow by what it expects, and tries to make others do so (specs/17-simulation.md, Lies).

That an owner itself overrules an expectation nobody can prevent: it is reported. What it offers to others is one more attempt in the
history of the place: whoever takes it over what it does not expect makes that history impossible.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import trio

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId
from scenefold.peer import NodeContext
from scenefold.simulation.liar import Liar
from scenefold.simulation.lies import Way
from scenefold.simulation.recording import Recorder, named
from scenefold.store import Outcome, Put, PutResult
from scenefold.wire import PutItem, PutMany, PutManyReply
from scenefold.world import Priority

AGAIN_S_MAX = 2.0


class LyingJudge:
    """Of one liar."""

    def __init__(self, liar: Liar, recorder: Recorder) -> None:
        self._liar = liar
        self._recorder = recorder
        self._overruled: set[bytes] = set()
        self._context: NodeContext | None = None

    def possess(self, context: NodeContext) -> None:
        """Judge for one life of the node."""
        store: Any = context.store
        judged = store.put
        self._context = context

        async def put(puts: Sequence[Put], *debtors: Sequence[Sequence[NodeId]]) -> list[PutResult]:
            results: list[PutResult] = list(await judged(puts, *debtors))
            for index, result in enumerate(results):
                if result.outcome is Outcome.EXISTS and puts[index].record.header.digest in self._overruled:
                    # As a copy: of that nobody asks what it expects.
                    [merged] = await context.store.merge([puts[index]], *([owed[index]] for owed in debtors))
                    results[index] = replace(merged, location=result.location)
            return results

        store.put = put

    def overrules(self, item: PutItem) -> None:
        """From now on this record is stored whatever it expects."""
        self._overruled.add(named(item)[1].digest)

    def has_judged(self, item: PutItem) -> None:
        self._overruled.discard(named(item)[1].digest)

    async def offer_again(self) -> None:
        """Offer some write that was refused, as any member can, to whoever owns its place by now. The bytes it has from who wrote them."""
        context, refused = self._context, self._recorder.refused
        if context is None or context is not self._liar.node.context or not refused:
            return
        item = self._liar.dice.choice(refused)
        place, _ = named(item)
        try:
            owner = context.routing.owner_of(place.home)
        except Refused:
            return
        if owner == context.me:
            return
        begin, outcomes = self._recorder.histories.moment(), None
        self._liar.lies.told["offered again"] += 1
        try:
            with trio.move_on_after(AGAIN_S_MAX):
                answer = await context.peers.ask(owner, Priority.LOW, PutMany((item,)), PutManyReply, AGAIN_S_MAX)
                outcomes = [outcome.reason for outcome in answer.outcomes]
        except (Refused, Unreachable, PeerFault, RuntimeError):
            # The last: its life has ended in the midst of it, and with it what it asks by.
            return
        finally:
            self._recorder.written(Way(f"node:{owner}", self._liar.node.name), begin, [item], outcomes)
