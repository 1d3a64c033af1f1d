"""The organiser's side of moving cells: rounds, and one step after the other of all nodes (specs/29-moving-cells.md)."""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import trio

from scenefold.base.errors import ScenefoldError
from scenefold.partition.division import Division
from scenefold.render.pool.division_moves import DivisionMoves
from scenefold.render.pool.hold import PREPARE_S_MAX
from scenefold.render.pool.moves import Told
from scenefold.render.pool.share import FILM_LANE
from scenefold.wire import Value
from scenefold.world import Clock, Workers

CLAIM_S_MAX = 30.0

_log = logging.getLogger("scenefold.render.pool")


@dataclass(frozen=True, slots=True)
class Pace:
    """How readily cells move.

    `look_s`: seconds between two looks. `rest`: after a move cells stay for so many times as long as it took, since loading what they lack may cost
    the nodes a part of their time, and no more. `worth`: cells stay unless the busiest node's lead, over what is left of the level, is so many
    times as long as the last move took; else it costs more than it wins.
    """

    look_s: float = 0.2
    rest: float = 8.0
    worth: float = 2.0


USUAL_PACE = Pace()


class Noted(Protocol):
    """Told of a move."""

    def __call__(self, division: Division, *, is_claimed: bool) -> None: ...


class Mover:
    """Of one attempt of a job."""

    def __init__(
        self,
        moves: DivisionMoves,
        clock: Clock,
        workers: Workers,
        told: Callable[[], Sequence[Told]],
        to_all: Callable[[dict[str, Value], float], Awaitable[None]],
        left_s: Callable[[], float],
        noted: Noted,
        pace: Pace = USUAL_PACE,
    ) -> None:
        """`told`: by all nodes, lately; none, as long as not all have told. `to_all`: an event that every node must take.

        `left_s`: how long the rest of the job will take, as far as it can be told. `noted`: hears of each move, before any node does, and
        when all have claimed it.
        """
        self._moves, self._clock, self._workers, self._told, self._to_all, self._left_s = moves, clock, workers, told, to_all, left_s
        self._noted, self._pace = noted, pace
        self._took_s = 0.0

    async def run(self) -> None:
        """Move cells after every round, until cancelled, or until a node cannot."""
        while True:
            await self._clock.sleep(max(self._pace.look_s, self._pace.rest * self._took_s))
            told = self._told()
            if not told or not self._moves.is_due(told) or not self._is_worth(told):
                continue
            try:
                after = await self._workers.run(FILM_LANE, self._moves.next, told)
            except Exception as fault:  # noqa: BLE001  a rule may be a package's, and an image is worth more than its cells
                _log.warning("cells stay where they are from now on: their rule failed, %s: %s", type(fault).__name__, fault)
                return
            if after is self._moves.division:
                continue
            begun = trio.current_time()
            self._noted(after, is_claimed=False)
            if not await self._fetched(after):
                return
            await self._to_all({"claim": after.epoch}, CLAIM_S_MAX)
            self._moves.division = after
            self._took_s = trio.current_time() - begun
            self._noted(after, is_claimed=True)

    def _is_worth(self, told: Sequence[Told]) -> bool:
        return self._left_s() * self._moves.idle_share(told) >= self._pace.worth * self._took_s

    async def _fetched(self, after: Division) -> bool:
        refused = ""
        try:
            await self._to_all({"fetch": dict(after.to_document())}, PREPARE_S_MAX)
        except* ScenefoldError as group:
            refused = str(group.exceptions[0])
        if refused:
            _log.warning("cells stay where they are from now on: %s", refused)
            await self._to_all({"forget": after.epoch}, CLAIM_S_MAX)
        return not refused
