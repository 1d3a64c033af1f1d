"""A node's side of previews: what its closed passes come to goes along the line to the organiser, and is added up on the way (specs/34-previews.md).

As films are gathered, but nothing is moved by it, and little travels. So one that fails costs nothing but itself.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial

import trio

from scenefold.base.errors import PeerFault, Refused, ScenefoldError
from scenefold.base.ids import NodeId, address_of
from scenefold.base.reasons import RejectReason
from scenefold.render.job import Job
from scenefold.render.pool.films import Films
from scenefold.render.pool.host import Host
from scenefold.render.pool.promises import Account
from scenefold.render.pool.roster import Roster
from scenefold.render.pool.share import FILM_LANE
from scenefold.render.pool.telling import told
from scenefold.render.preview import Sums, add_rows, nothing_of, preview_bytes, unpack_preview
from scenefold.wire import FetchPreview, ImagePart, Packet
from scenefold.world import leaves

PAUSE_S = 1.0
"""Between two previews of a job at least, whoever wants them."""
MAKE_S_MAX = 45.0
"""For one, with all that comes from others; less than a client waits for an answer."""
ANSWER_S = 10.0
"""For a node to add up what it has,"""
HOP_S = 0.25
"""and for each node behind it."""
PART_BYTES = 512 * 1024
COPIES = 6
"""Of a preview at a node that makes one: its own, what comes from both sides, their sum as it goes out, and the one before."""
ROWS_AT_A_TIME = 65_536
"""Between two of them whoever closes a pass may have its turn."""
_NAME = "preview"


class Previewing:
    """Of one part. `newest`: the number of the newest preview that it has made as the job's organiser; 0 for none."""

    def __init__(self, host: Host, job: Job, films: Films, turn: trio.Lock, account: Account) -> None:
        """`turn`: of whoever changes a film. `account`: of the memory that the part takes."""
        self._host, self._job, self._films, self._turn, self._account = host, job, films, turn, account
        self._size = (job.window.width, job.window.height)
        self._bytes = preview_bytes(*self._size)
        self._making: trio.CancelScope | None = None
        self._made: tuple[int, bytes] = (0, b"")
        self._tried_at = -PAUSE_S
        self._passes = 0
        """That were closed when the newest one was made, of this attempt."""
        self.newest = 0

    async def of_all(self, number: int, offset: int, roster: Roster, closed: int) -> ImagePart:
        """At the organiser, for its user: a part of the newest preview; of a new one if that has the next number. `closed`: passes by now.

        Refused (16) if there is no such preview: a newer one is there, or it is too early for one, or a node does not answer.
        """
        if number == self.newest + 1 and not offset:
            if trio.current_time() - self._tried_at < PAUSE_S:
                raise _not_yet("a preview was made a moment ago")
            if closed in (0, self._passes):
                raise _not_yet("nothing is done that the newest preview does not show")
            place = roster.nodes.index(self._host.node_id)
            await self._make(number, roster, (place - 1, place + 1))
            self.newest, self._passes = number, closed
        return self._part(number, offset)

    async def of_those_behind(self, number: int, offset: int, roster: Roster, towards: NodeId) -> ImagePart:
        """For the neighbour on the organiser's side: a part of what this node and all behind it have.

        Refused (12) for anybody else, (16) if another one was made meanwhile.
        """
        place, organiser, asker = (roster.place(node) for node in (self._host.node_id, roster.organiser, towards))
        assert place is not None and organiser is not None
        step = (organiser > place) - (organiser < place)
        if not step or asker != place + step:
            raise Refused(RejectReason.NOT_AUTHORISED, "previews go to the neighbour on the organiser's side", where=address_of(towards))
        if not offset:
            await self._make(number, roster, (place - step,))
        return self._part(number, offset)

    def forget(self) -> None:
        """An attempt ends: what is being made is of it, and memory is wanted for other things."""
        if self._making is not None:
            self._making.cancel()
        self._made, self._passes = (0, b""), 0
        self._account.give_back(_NAME)

    async def _make(self, number: int, roster: Roster, neighbours: tuple[int, ...]) -> None:
        """What we have, and all behind these places."""
        if self._making is not None:
            raise Refused(RejectReason.BUSY, "a preview is being made", remedy="ask again in a moment")
        self._tried_at = trio.current_time()
        is_made = False
        with trio.move_on_after(MAKE_S_MAX) as self._making:
            try:
                self._promise(COPIES * self._bytes)
                payload = await self._all_of(number, roster, [place for place in neighbours if 0 <= place < len(roster.nodes)])
                self._made, is_made = (number, payload), True
            finally:
                self._making = None
                self._promise(len(self._made[1]))
        if not is_made:
            raise _not_yet("a preview could not be made in time")

    async def _all_of(self, number: int, roster: Roster, neighbours: Iterable[int]) -> bytes:
        gathered, problem = self._films.gathered, None
        own, others = nothing_of(*self._size), list[Sums]()
        try:
            async with trio.open_nursery() as nursery:
                nursery.start_soon(self._add_own, own)
                for place in neighbours:
                    nursery.start_soon(self._fetch, number, roster, place, others)
        except* ScenefoldError as group:
            problem = next(leaves(group))
        if isinstance(problem, ScenefoldError):
            raise told(problem)
        if self._films.gathered != gathered:
            # What was another's before is ours now, or has gone; of some it may be missing.
            raise _not_yet("films were gathered meanwhile")
        return await self._host.world.workers.run(FILM_LANE, _packed, own, others)

    async def _add_own(self, sums: Sums) -> None:
        """In turns with who adds passes to films, or gathers them."""
        film = None
        for first in range(0, self._job.window.pixels, ROWS_AT_A_TIME):
            async with self._turn:
                own = self._films.own
                # Nobody's film is made for that: whoever has closed nothing may have none.
                now = own.film if own.passes else None
                if film is not None and now is not film:
                    raise _not_yet("films were gathered meanwhile")
                film = now
                if film is not None:
                    await self._host.world.workers.run(FILM_LANE, partial(add_rows, sums, film, first, first + ROWS_AT_A_TIME))

    async def _fetch(self, number: int, roster: Roster, place: int, others: list[Sums]) -> None:
        me, payload = roster.nodes.index(self._host.node_id), bytearray()
        behind = place + 1 if place < me else len(roster.nodes) - place
        while len(payload) < self._bytes:
            packet = FetchPreview(job=self._job.id, number=number, offset=len(payload))
            part = await self._host.ask(roster.nodes[place], packet, ANSWER_S + HOP_S * behind)
            payload += self._fitting(part, len(payload), roster.nodes[place])
        others.append(await self._host.world.workers.run(FILM_LANE, unpack_preview, payload, *self._size))

    def _fitting(self, part: Packet, offset: int, node: NodeId) -> bytes:
        payload = part.payload if isinstance(part, ImagePart) and (part.offset, part.total_bytes) == (offset, self._bytes) else b""
        if not 0 < len(payload) <= self._bytes - offset:
            raise PeerFault("a part of a preview does not fit", where=address_of(node))
        return payload

    def _promise(self, needs: int) -> None:
        """So many bytes in all."""
        try:
            self._account.take(_NAME, needs, "a preview", "wait for the image")
        except ScenefoldError as error:
            raise told(error) from None

    def _part(self, number: int, offset: int) -> ImagePart:
        if self._made[0] != number:
            raise _not_yet("that preview is not there, or no longer")
        preview = self._made[1]
        payload = preview[offset : offset + PART_BYTES]
        return ImagePart(job=self._job.id, total_bytes=len(preview), offset=min(offset, len(preview)), payload=payload)


def _packed(own: Sums, others: Iterable[Sums]) -> bytes:
    for one in others:
        own += one
    return own.astype("<f4", copy=False).tobytes()


def _not_yet(what: str) -> Refused:
    return Refused(RejectReason.NOT_READY, what, remedy="ask again in a moment")
