"""What is being stored while somebody may read: so nobody is answered before what was judged by an older header is on the disk.

Whoever reads for an image names the position of his header. From the first answer on this node takes no record that the header of that
position forbids (specs/26-modes.md, What storage nodes do in render mode). A record that was judged before that header came, and is not
stored yet, would come behind such an answer.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import trio

from scenefold.base.errors import Refused
from scenefold.base.ids import SceneId
from scenefold.base.reasons import RejectReason

FENCE_S_MAX = 2.0
"""How long a reader waits for writes; what takes longer waits for other nodes, and he asks again."""


class Fence:
    """Used from the Trio thread only."""

    def __init__(self) -> None:
        self._storing: list[Mapping[SceneId, int]] = []
        self._ended = trio.Event()

    @contextmanager
    def storing(self, positions: Mapping[SceneId, int]) -> Iterator[None]:
        """Records of these scenes are being stored, judged by the headers of these positions. Nothing may be waited for between the two."""
        self._storing.append(positions)
        try:
            yield
        finally:
            self._storing = [other for other in self._storing if other is not positions]
            self._ended.set()
            self._ended = trio.Event()

    async def passed(self, scene: SceneId, floor: int) -> None:
        """Return once nothing is being stored that was judged by a header below this write floor; Refused (16) if that takes long."""
        with trio.move_on_after(FENCE_S_MAX):
            while any(positions.get(scene, floor) < floor for positions in self._storing):
                await self._ended.wait()
            return
        raise Refused(RejectReason.NOT_READY, "records of before a change of mode or members are being stored", remedy="ask again")
