"""What a render looks like on its way, as a picture in a file, for whoever waits (specs/34-previews.md)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from scenefold.base.errors import Refused, UsageFault
from scenefold.base.reasons import RejectReason
from scenefold.client import Cluster
from scenefold.render.image_files import check_writable, write_png
from scenefold.render.job import RenderOptions
from scenefold.render.preview import picture_of, preview_bytes, unpack_preview
from scenefold.render.view import AGX

PREVIEW_S_MIN, PREVIEW_S_MAX = 1.0, 86_400.0
PREVIEW_AGAIN_S = 2.0
"""After one that could not be had."""


@dataclass(frozen=True, slots=True)
class Previews:
    """What a render looks like on its way: a PNG that is written anew every so many seconds."""

    path: Path
    every_s: float = 10.0
    view: str = AGX
    exposure: float | None = None
    """In stops; None: as each picture asks."""
    missed: Callable[[Refused], object] = str
    """Hears why there are none, if they cannot be had for this render."""

    def __post_init__(self) -> None:
        if not PREVIEW_S_MIN <= self.every_s <= PREVIEW_S_MAX:
            what = f"a preview every {self.every_s:g} s"
            raise UsageFault(what, where="previews", remedy=f"give {PREVIEW_S_MIN:g} to {PREVIEW_S_MAX:,g} seconds")


class Previewer:
    """The picture of a render on its way, in a file that is replaced once in a while."""

    def __init__(self, cluster: Cluster, previews: Previews, options: RenderOptions) -> None:
        check_writable(previews.path)
        self._cluster, self._previews, self._window = cluster, previews, options.window
        self.due_at = -math.inf
        """On the world's clock."""

    @property
    def size(self) -> int:
        """Of a preview as it travels, in bytes."""
        return preview_bytes(self._window.width, self._window.height)

    async def write(self, preview: bytes) -> None:
        """In place of the one before."""
        await self._cluster.in_worker("import", self._write, preview)
        self.wait(self._previews.every_s)

    def missed(self, why: Refused) -> None:
        """Try again in a while, if that can help."""
        if why.reason in (RejectReason.NOT_READY, RejectReason.BUSY):
            self.wait(PREVIEW_AGAIN_S)
        else:
            self.due_at = math.inf
            self._previews.missed(why)

    def wait(self, seconds: float) -> None:
        """The next one is due then."""
        self.due_at = self._cluster.calls.world.clock.now() + seconds

    def _write(self, preview: bytes) -> None:
        beauty = picture_of(unpack_preview(preview, self._window.width, self._window.height))
        write_png(self._previews.path, beauty, self._previews.exposure, self._previews.view)
