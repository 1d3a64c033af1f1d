"""The sending half of a connection: one task that sends whole frames, one after another.

A caller hands its frame over and may then be cancelled: the frame still leaves whole, so a cancelled request never
breaks the stream for the others. There is no queue: a caller waits until the sender takes its frame, so what one
connection holds is what its callers hold anyway. Small frames that wait together leave together.
"""

from __future__ import annotations

import trio

from scenefold.base.limits import SEND_STALL_S_MAX
from scenefold.world.ports import Connection, ConnectionLost

PIECE_BYTES = 256 * 1024
"""Progress is judged by pieces of this size."""
TOGETHER_BYTES_MAX = 64 * 1024


class Outbox:
    """Frames of many tasks for one connection; `run` in a task."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._entrance, self._exit = trio.open_memory_channel[bytes](0)
        self._finished = trio.Event()
        self.moved_at = float("-inf")
        """When a piece last left, by Trio's clock."""

    async def put(self, frame: bytes) -> None:
        """Returns once the sender has the frame; ConnectionLost if it takes none any more."""
        try:
            await self._entrance.send(frame)
        except (trio.BrokenResourceError, trio.ClosedResourceError):
            raise ConnectionLost("the connection is closed") from None

    async def run(self) -> None:
        """Send until `finish`; ConnectionLost if the connection is, or makes no progress."""
        try:
            async for frame in self._exit:
                await self._send(self._together(frame))
        finally:
            self._exit.close()
            self._finished.set()

    async def finish(self) -> None:
        """Take no more, and wait until what was taken has left."""
        self._entrance.close()
        await self._finished.wait()

    def _together(self, frame: bytes) -> bytes:
        frames, size_bytes = [frame], len(frame)
        while size_bytes < TOGETHER_BYTES_MAX:
            try:
                following = self._exit.receive_nowait()
            except (trio.WouldBlock, trio.EndOfChannel):
                break
            frames.append(following)
            size_bytes += len(following)
        return frame if len(frames) == 1 else b"".join(frames)

    async def _send(self, data: bytes) -> None:
        view = memoryview(data)
        for start in range(0, len(view), PIECE_BYTES):
            with trio.move_on_after(SEND_STALL_S_MAX) as patience:
                await self._connection.send(view[start : start + PIECE_BYTES])
            if patience.cancelled_caught:
                raise ConnectionLost(f"the peer read nothing for {SEND_STALL_S_MAX:g} s")
            self.moved_at = trio.current_time()
