"""A node's side of previews: what its closed passes come to goes along the line to the organiser, and is added up on the way (specs/34-previews.md).

As films are gathered, but nothing is moved by it, and little travels. So one that fails costs nothing but itself.
"""

from __future__ import annotations

import trio

from scenefold.base.errors import PeerFault, Refused, ScenefoldError
from scenefold.base.ids import address_of
from scenefold.base.reasons import RejectReason
from scenefold.render.job import Job
from scenefold.render.pool.films import Films
from scenefold.render.pool.host import Host
from scenefold.render.pool.promises import Account
from scenefold.render.pool.roster import Roster
from scenefold.render.pool.share import FILM_LANE
from scenefold.render.pool.telling import told
from scenefold.render.preview import Sums, nothing_of, preview_bytes, preview_of, unpack_preview
from scenefold.wire import FetchPreview, ImagePart
from scenefold.world import leaves

PAUSE_S = 1.0
"""Between two previews of a job at least, whoever wants them."""
ANSWER_S = 20.0
"""For a node to add up what it has,"""
HOP_S = 5.0
"""and for each node behind it."""
PART_BYTES = 4 * 1024 * 1024
COPIES = 7
"""Of a preview at a node: its own, what comes from both sides, that as it came, their sum, and what others fetch."""


class Previewing:
    """Of one part. `newest`: the number of the newest preview that it has made as the job's organiser; 0 for none."""

    def __init__(self, host: Host, job: Job, films: Films, turn: trio.Lock, account: Account) -> None:
        """`turn`: of whoever changes a film. `account`: of the memory that the part takes."""
        self._host, self._job, self._films, self._turn, self._account = host, job, films, turn, account
        self._size = (job.window.width, job.window.height)
        self._making = trio.Lock()
        self._made: tuple[int, bytes] = (0, b"")
        self._made_at = -PAUSE_S
        self._passes = 0
        """That were closed when the newest one was made."""
        self.newest = 0

    async def of_all(self, number: int, offset: int, roster: Roster, closed: int) -> ImagePart:
        """At the organiser, for its user: a part of the newest preview; of a new one if that has the next number. `closed`: passes by now.

        Refused (16) if there is no such preview: a newer one is there, or it is too early for one, or a node does not answer.
        """
        async with self._making:
            if number == self.newest + 1 and not offset:
                self._check_due(closed)
                place = roster.nodes.index(self._host.node_id)
                await self._make(number, roster, (place - 1, place + 1))
                self.newest, self._passes, self._made_at = number, closed, trio.current_time()
        return self._part(number, offset)

    async def of_those_behind(self, number: int, offset: int, roster: Roster, towards: int) -> ImagePart:
        """For the neighbour at a place: a part of what this node and all behind it have. Refused (16) if another one was made meanwhile."""
        if not offset:
            async with self._making:
                place = roster.nodes.index(self._host.node_id)
                await self._make(number, roster, (2 * place - towards,))
        return self._part(number, offset)

    def _check_due(self, closed: int) -> None:
        if trio.current_time() - self._made_at < PAUSE_S:
            raise _not_yet("a preview was made a moment ago")
        if closed <= self._passes:
            raise _not_yet("nothing is done that the newest preview does not show")

    async def _make(self, number: int, roster: Roster, neighbours: tuple[int, ...]) -> None:
        """What we have, and all behind these places."""
        sums, problem = list[Sums](), None
        try:
            self._account.take("preview", COPIES * preview_bytes(*self._size), "a preview", "wait for the image")
            async with trio.open_nursery() as nursery:
                nursery.start_soon(self._own, sums)
                for place in neighbours:
                    if 0 <= place < len(roster.nodes):
                        nursery.start_soon(self._fetched, number, roster, place, sums)
        except* ScenefoldError as group:
            problem = next(leaves(group))
        if isinstance(problem, ScenefoldError):
            raise told(problem)
        self._made = number, await self._host.world.workers.run(FILM_LANE, _added, sums)

    async def _own(self, sums: list[Sums]) -> None:
        async with self._turn:
            own = self._films.own
            # Nobody's film is made for that: whoever has closed nothing may have none.
            work = preview_of if own.passes else None
            sums.append(nothing_of(*self._size) if work is None else await self._host.world.workers.run(FILM_LANE, work, own.film))

    async def _fetched(self, number: int, roster: Roster, place: int, sums: list[Sums]) -> None:
        me, size = roster.nodes.index(self._host.node_id), preview_bytes(*self._size)
        behind = place + 1 if place < me else len(roster.nodes) - place
        payload = bytearray()
        while len(payload) < size:
            packet = FetchPreview(job=self._job.id, number=number, offset=len(payload))
            part = await self._host.ask(roster.nodes[place], packet, ANSWER_S + HOP_S * behind)
            if not isinstance(part, ImagePart) or part.offset != len(payload) or not part.payload or part.total_bytes != size:
                raise PeerFault("a part of a preview does not fit", where=address_of(roster.nodes[place]))
            payload += part.payload
        sums.append(await self._host.world.workers.run(FILM_LANE, unpack_preview, bytes(payload), *self._size))

    def _part(self, number: int, offset: int) -> ImagePart:
        if self._made[0] != number:
            raise _not_yet("that preview is not there, or no longer")
        preview = self._made[1]
        payload = preview[offset : offset + PART_BYTES]
        return ImagePart(job=self._job.id, total_bytes=len(preview), offset=min(offset, len(preview)), payload=payload)


def _added(sums: list[Sums]) -> bytes:
    whole = sums[0].copy()
    for one in sums[1:]:
        whole += one
    return whole.astype("<f4").tobytes()


def _not_yet(what: str) -> Refused:
    return Refused(RejectReason.NOT_READY, what, remedy="ask again in a moment")
