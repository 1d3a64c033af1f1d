"""An attack as a process that lasts as long as a block."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any

import trio

BEGIN_S_MAX = 60.0
END_S_MAX = 30.0
LAST_WORDS_BYTES_MAX = 8_192


@dataclass
class Report:
    """What an attack did, as of half a second ago; all of it once it has ended."""

    seconds: float = 0.0
    cpu_s: float = 0.0
    seen: dict[str, int] = field(default_factory=dict)
    has_begun: trio.Event = field(default_factory=trio.Event)
    last_words: bytes = b""
    """The end of what it wrote for people."""

    async def follow(self, process: trio.Process) -> None:
        """Until the process has ended."""
        async with trio.open_nursery() as nursery:
            nursery.start_soon(self._overhear, process)
            await self._take_reports(process)

    async def _take_reports(self, process: trio.Process) -> None:
        assert process.stdout is not None
        rest = b""
        while more := await process.stdout.receive_some():
            *lines, rest = (rest + more).split(b"\n")
            for line in lines:
                said = json.loads(line)
                self.seconds, self.cpu_s, self.seen = said["seconds"], said["cpu_s"], said["seen"]
                self.has_begun.set()

    async def _overhear(self, process: trio.Process) -> None:
        assert process.stderr is not None
        while more := await process.stderr.receive_some():
            self.last_words = (self.last_words + more)[-LAST_WORDS_BYTES_MAX:]


@asynccontextmanager
async def attacking(settings: dict[str, Any]) -> AsyncIterator[Report]:
    """`settings` as for `python -m scenectl.attacks`. Begins when the attack does: an interpreter takes a second to start, or five.

    No attack ends by itself: if this one does, so does the block, at once, with a RuntimeError that holds what the process said.
    """
    report, is_asked_to_end = Report(), False
    command = [sys.executable, "-m", "scenectl.attacks", json.dumps(settings)]
    pipe = subprocess.PIPE
    process = await trio.lowlevel.open_process(command, stdin=pipe, stdout=pipe, stderr=pipe)
    assert process.stdin is not None and process.stdout is not None and process.stderr is not None

    async def follow(block: trio.CancelScope) -> None:
        await report.follow(process)
        if not is_asked_to_end:
            block.cancel()

    try:
        async with trio.open_nursery() as nursery:
            nursery.start_soon(follow, nursery.cancel_scope)
            with trio.fail_after(BEGIN_S_MAX):
                await report.has_begun.wait()
            yield report
            is_asked_to_end = True
            await process.stdin.aclose()
            with trio.fail_after(END_S_MAX):
                await process.wait()
        if await process.wait() or not is_asked_to_end:
            raise RuntimeError(f"the attacker ended by itself, with {process.returncode}: {report.last_words.decode(errors='replace')}")
    finally:
        if process.returncode is None:
            process.kill()
        with trio.CancelScope(shield=True):
            await process.wait()
            await process.stdin.aclose()
            await process.stdout.aclose()
            await process.stderr.aclose()
