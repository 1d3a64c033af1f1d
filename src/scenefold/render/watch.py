"""One job at its organiser, as the client that wants the image sees it; and what it keeps of it on the way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import trio

from scenefold.base.errors import PeerFault, Refused, ScenefoldError, Unreachable
from scenefold.base.reasons import RejectReason
from scenefold.client import Cluster
from scenefold.render.job import RenderOptions
from scenefold.render.kept import KeptRender, asked_of, check_keepable, write_kept
from scenefold.render.pool.kept_film import PIECE_BYTES, film_size
from scenefold.render.pool.request import Keep, RenderRequest
from scenefold.render.pool.telling import error_of
from scenefold.render.preview_files import Previewer
from scenefold.render.reports import Stand, numeric_class_of, stand_of
from scenefold.wire import (
    CancelJob,
    FetchFilm,
    FetchImage,
    FetchPreview,
    FilmPart,
    ImagePart,
    JobAnswer,
    JobState,
    JobStateReply,
    Packet,
    StartJob,
)
from scenefold.world import background_tasks

ASK_S_MAX = 60.0
POLL_S = 0.25
LETTING_GO_S_MAX = 10.0
_AGAIN = "start it again; with --resume it goes on from what was kept"

Progress = Callable[[str, int, int], None]
"""Called with a phase's name, and how much of how much is done."""
A = TypeVar("A", bound=Packet)


def _unseen(_stand: Stand) -> None:
    """Who wants no more than the progress."""


class Keeper:
    """The file of a kept render."""

    def __init__(self, cluster: Cluster, path: Path, options: RenderOptions, kept: KeptRender | None) -> None:
        check_keepable(path)
        self._cluster, self._path, self._options = cluster, path, options
        self.keep = Keep() if kept is None else kept.keep
        """What it holds."""

    def size(self, passes: int) -> int:
        """Of the film of so many passes."""
        return film_size(self._options.plan, self._options.columns, self._options.window.pixels, passes)

    async def write(self, keep: Keep, film: bytes) -> None:
        """In place of what it held."""
        await self._cluster.in_worker("import", write_kept, self._path, KeptRender(asked_of(self._options), keep, film))
        self.keep = keep


class Watch:
    """One job at its organiser."""

    def __init__(self, cluster: Cluster, address: str, job: int) -> None:
        self._cluster, self._address, self._job = cluster, address, job

    async def start(self, request: RenderRequest) -> None:
        answer = await self._ask(StartJob(job=self._job, document=request.to_bytes()), JobAnswer)
        if answer.reason:
            raise error_of(answer.reason, answer.text, where=self._address)

    async def send_film(self, film: bytes) -> None:
        """What the job goes on from."""
        count = -(-len(film) // PIECE_BYTES)
        for index in range(count):
            payload = film[index * PIECE_BYTES : (index + 1) * PIECE_BYTES]
            answer = await self._ask(FilmPart(job=self._job, gathering=0, part_index=index, part_count=count, payload=payload), JobAnswer)
            if answer.reason:
                raise error_of(answer.reason, answer.text, where=self._address)

    async def stand(self) -> Stand:
        """How it stands now. What it failed of is raised; PeerFault if the organiser says what makes no sense."""
        try:
            reply = await self._ask(JobState(job=self._job), JobStateReply)
        except Unreachable as error:
            raise Unreachable(f"the node that organises the render is lost: {error.what}", where=self._address, remedy=_AGAIN) from error
        except Refused as refused:
            if refused.reason is not RejectReason.NOT_READY:
                raise
            what = "the node that organised the render was started anew, and knows nothing of it"
            raise Refused(RejectReason.NOT_READY, what, where=self._address, remedy=_AGAIN) from refused
        stand = stand_of(reply.document, self._address)
        if stand.phase == "failed":
            raise error_of(stand.failure_reason, stand.failure, where=self._address, before="the render failed: ")
        return stand

    async def until_traced(self) -> Stand:
        """Wait until nobody prepares any more; how it stands then. See `stand`."""
        while (stand := await self.stand()).phase == "preparing":
            await self._cluster.calls.world.clock.sleep(POLL_S)
        return stand

    async def until_done(
        self,
        progress: Progress,
        keeper: Keeper | None = None,
        lost: Callable[[str], object] = str,
        back: Callable[[str], object] = str,
        seen: Callable[[Stand], object] = _unseen,
        previewer: Previewer | None = None,
    ) -> Stand:
        """How it stands at the end; what it keeps on the way is written down, who is lost, or back, is told, and `seen` all on the way. See `stand`.

        `previewer`: makes pictures meanwhile.
        """
        if previewer is None:
            return await self._until_done(progress, keeper, lost, back, seen)

        def both(stand: Stand) -> None:
            seen(stand)
            previewer.sees(stand)

        async with background_tasks() as nursery:
            nursery.start_soon(previewer.run, self._preview)
            return await self._until_done(progress, keeper, lost, back, both)

    async def _until_done(
        self,
        progress: Progress,
        keeper: Keeper | None,
        lost: Callable[[str], object],
        back: Callable[[str], object],
        seen: Callable[[Stand], object],
    ) -> Stand:
        clock, is_prepared, lost_so_far, back_so_far = self._cluster.calls.world.clock, False, 0, 0
        while True:
            stand = await self.stand()
            seen(stand)
            for address in stand.lost[lost_so_far:]:
                lost(address)
            for address in stand.back[back_so_far:]:
                back(address)
            lost_so_far, back_so_far = len(stand.lost), len(stand.back)
            if stand.phase in ("rendering", "done") and not is_prepared:
                is_prepared = True
                progress("prepare", 1, 1)
            if stand.phase == "rendering":
                progress("render", stand.closed, stand.passes)
                if keeper is not None and stand.kept > keeper.keep.passes:
                    await self._keep(keeper, stand)
                    continue
            if stand.phase == "done":
                progress("render", stand.passes, stand.passes)
                return stand
            await clock.sleep(POLL_S)

    async def _keep(self, keeper: Keeper, stand: Stand) -> None:
        """Fetch the newest film, and write it down. That it is kept no longer is no fault: there is a newer one, or the image."""
        size = keeper.size(stand.kept)
        try:
            film = await self._fetched(size, lambda at: FetchFilm(job=self._job, passes=stand.kept, offset=at), lambda _done, _all: None)
        except Refused as refused:
            if refused.reason is not RejectReason.NOT_READY:
                raise
            await self._cluster.calls.world.clock.sleep(POLL_S)
            return
        await keeper.write(Keep(stand.kept, stand.content, numeric_class_of(stand, self._address)), film)

    async def _preview(self, number: int, size: int) -> bytes:
        return await self._fetched(size, lambda at: FetchPreview(job=self._job, number=number, offset=at), lambda _done, _all: None)

    async def fetch(self, size: int, progress: Callable[[int, int], None]) -> bytes:
        """The image, which has this size. PeerFault if it has another one."""
        return await self._fetched(size, lambda at: FetchImage(job=self._job, offset=at), progress)

    async def _fetched(self, size: int, packet: Callable[[int], Packet], progress: Callable[[int, int], None]) -> bytes:
        image = bytearray()
        while len(image) < size:
            part = await self._ask(packet(len(image)), ImagePart)
            if part.total_bytes != size or part.offset != len(image) or not part.payload or len(image) + len(part.payload) > size:
                raise PeerFault("a part of the image does not fit", where=self._address)
            image += part.payload
            progress(len(image), size)
        return bytes(image)

    async def let_go(self) -> None:
        """Free the job also when we are cancelled; a node that does not answer frees it by itself later."""
        with trio.move_on_after(LETTING_GO_S_MAX, shield=True):
            try:
                await self.cancel()
            except ScenefoldError:
                return  # what it is worth is known by now

    async def cancel(self) -> None:
        """Free the job. Unreachable; Refused (16) if the organiser knows it no longer."""
        await self._ask(CancelJob(job=self._job), JobAnswer)

    async def _ask(self, packet: Packet, answer: type[A]) -> A:
        return await self._cluster.calls.ask(self._address, replace(packet), answer, timeout_s=ASK_S_MAX)
