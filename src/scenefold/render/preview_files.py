"""What a render looks like on its way, as a picture in a file, for whoever waits (specs/34-previews.md)."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path

from scenefold.base.errors import Refused, ScenefoldError, Unreachable, UsageFault
from scenefold.base.reasons import RejectReason
from scenefold.client import Cluster
from scenefold.render.image_files import check_writable, write_png
from scenefold.render.job import RenderOptions
from scenefold.render.preview import picture_of, preview_bytes, unpack_preview
from scenefold.render.reports import Stand
from scenefold.render.view import AGX

PREVIEW_S_MIN, PREVIEW_S_MAX = 1.0, 86_400.0
LOOK_S = 0.25
"""While there is nothing to be shown."""
PAUSE_S, PAUSE_S_MAX = 2.0, 60.0
"""After one that could not be had; twice as long after each further one."""
TOLD_AFTER_S = 45.0
"""Of what may pass."""


@dataclass(frozen=True, slots=True)
class Previews:
    """What a render looks like on its way: a PNG that is written anew every so many seconds."""

    path: Path
    every_s: float = 10.0
    view: str = AGX
    exposure: float | None = None
    """In stops; None: as each picture asks."""
    missed: Callable[[ScenefoldError], object] = str
    """Hears, once a job, why there are none if they cannot be had."""

    def __post_init__(self) -> None:
        if not PREVIEW_S_MIN <= self.every_s <= PREVIEW_S_MAX:
            what = f"a preview every {self.every_s:g} s"
            raise UsageFault(what, where="previews", remedy=f"give {PREVIEW_S_MIN:g} to {PREVIEW_S_MAX:,g} seconds")


class Previewer:
    """The picture of a render on its way, in a file that is replaced once in a while. What fails of it is no fault of the render."""

    def __init__(self, cluster: Cluster, previews: Previews, options: RenderOptions) -> None:
        check_writable(previews.path)
        self._cluster, self._previews, self._window = cluster, previews, options.window
        self._stand: Stand | None = None

    def sees(self, stand: Stand) -> None:
        """How the render stands now."""
        self._stand = stand

    async def run(self, fetch: Callable[[int, int], Awaitable[bytes]]) -> None:
        """Of one job, until cancelled. `fetch(number, bytes)`: the preview of a number."""
        clock, missing, number, closed = self._cluster.calls.world.clock, Missing(self._previews.missed), 0, 0
        self._stand = None
        while True:
            stand = self._stand
            if stand is None or stand.phase != "rendering" or stand.closed == closed:
                await clock.sleep(LOOK_S)
                continue
            try:
                newest = max(number, stand.preview) + 1
                preview = await fetch(newest, preview_bytes(self._window.width, self._window.height))
                await self._cluster.in_worker("import", self._write, preview)
            except ScenefoldError as why:
                await clock.sleep(missing.missed(why, clock.now()))
            else:
                number, closed = newest, stand.closed
                missing.had()
                await clock.sleep(self._previews.every_s)

    def _write(self, preview: bytes) -> None:
        beauty = picture_of(unpack_preview(preview, self._window.width, self._window.height))
        write_png(self._previews.path, beauty, self._previews.exposure, self._previews.view)


class Missing:
    """Previews that could not be had, one after the other. Pure."""

    def __init__(self, tell: Callable[[ScenefoldError], object]) -> None:
        self._tell: Callable[[ScenefoldError], object] | None = tell
        self._count, self._since = 0, 0.0

    def missed(self, why: ScenefoldError, now: float) -> float:
        """Seconds until the next one is tried. Why there are none is told once: at once if that stays so, as far as is known, or after a while."""
        self._since = self._since if self._count else now
        self._count += 1
        may_pass = isinstance(why, Unreachable) or (isinstance(why, Refused) and why.reason in (RejectReason.NOT_READY, RejectReason.BUSY))
        if self._tell is not None and (not may_pass or now - self._since >= TOLD_AFTER_S):
            self._tell(why)
            self._tell = None
        return min(PAUSE_S_MAX, PAUSE_S * 2.0 ** min(self._count - 1, 16))

    def had(self) -> None:
        """There is one."""
        self._count = 0
