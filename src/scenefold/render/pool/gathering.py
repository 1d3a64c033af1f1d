"""A node's side of a gathering: films go along the line to the organiser, and are added up on the way (specs/31-attempts.md).

So no node receives more than two (thesis B.4.2). Nobody's own film changes before all have come.
"""

from __future__ import annotations

from collections.abc import Collection
from functools import partial

import trio

from scenefold.base.ids import NodeId, address_of
from scenefold.render.job import Job
from scenefold.render.pool.films import Films
from scenefold.render.pool.host import Host
from scenefold.render.pool.roster import Roster
from scenefold.render.pool.share import FILM_LANE
from scenefold.render.pool.telling import error_of
from scenefold.wire import FilmPart, JobAnswer, MergeFilm, Packet

MERGE_S_MIN = 600.0
"""For all films behind a neighbour to come to it, at least."""
PART_S_MAX = 120.0
"""For a part of a film to go from a node to the next one."""


class Gathering:
    """Of one part."""

    def __init__(self, host: Host, job: Job, films: Films, turn: trio.Lock) -> None:
        """`turn`: of whoever changes a film."""
        self._host, self._job, self._films, self._turn = host, job, films, turn

    async def hand_on(self, number: int, roster: Roster, towards: int) -> None:
        """What the nodes behind this one have, and this one, to the neighbour at a place."""
        place = roster.nodes.index(self._host.node_id)
        async with self._turn:
            self._films.begin(number)
        behind = 2 * place - towards
        if 0 <= behind < len(roster.nodes):
            await self._collect(number, roster, behind)
        count = self._films.part_count
        for index in range(count):
            async with self._turn:
                payload = await self._host.world.workers.run(FILM_LANE, self._films.part, index)
            packet = FilmPart(job=self._job.id, gathering=number, part_index=index, part_count=count, payload=payload)
            await self._ask(roster, towards, packet, PART_S_MAX)

    async def gather(self, number: int, roster: Roster, passes: Collection[int]) -> None:
        """Both neighbours' films, and all behind them, into ours; `passes`: that are summed in them."""
        place = roster.nodes.index(self._host.node_id)
        async with self._turn:
            self._films.begin(number)
        async with trio.open_nursery() as nursery:
            for neighbour in (place - 1, place + 1):
                if 0 <= neighbour < len(roster.nodes):
                    nursery.start_soon(self._collect, number, roster, neighbour)
        with trio.CancelScope(shield=True):
            async with self._turn:
                await self._host.world.workers.run(FILM_LANE, self._films.check_samples, passes, self._job.plan.size)
                await self._host.world.workers.run(FILM_LANE, self._films.take_gathered, passes)

    async def merge(self, sender: NodeId, packet: FilmPart) -> None:
        """A part of a neighbour's film. Refused if it is of an older gathering."""
        merge = partial(self._films.merge_part, packet.gathering, sender, packet.part_index, packet.payload)
        async with self._turn:
            await self._host.world.workers.run(FILM_LANE, merge)

    async def _collect(self, number: int, roster: Roster, place: int) -> None:
        me = roster.nodes.index(self._host.node_id)
        films = place + 1 if place < me else len(roster.nodes) - place
        await self._ask(roster, place, MergeFilm(job=self._job.id, gathering=number), merge_s_max(self._films.part_count, films))
        self._films.check_came(number, roster.nodes[place])

    async def _ask(self, roster: Roster, place: int, packet: Packet, timeout_s: float) -> None:
        answer = await self._host.ask(roster.nodes[place], packet, timeout_s)
        if isinstance(answer, JobAnswer) and answer.reason:
            raise error_of(answer.reason, answer.text, where=address_of(roster.nodes[place]))


def merge_s_max(parts: int, films: int) -> float:
    """How long a neighbour may take to have so many films come, of so many parts each, one behind the other: the last one is its own, to us.

    On a slow link a large film takes hours, and what is lost is noticed elsewhere (`Company`).
    """
    return max(MERGE_S_MIN, PART_S_MAX * parts * films)
