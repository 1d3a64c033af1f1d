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


@dataclass
class Report:
    """What an attack did, as of half a second ago; all of it once it has ended."""

    seconds: float = 0.0
    cpu_s: float = 0.0
    seen: dict[str, int] = field(default_factory=dict)
    has_begun: trio.Event = field(default_factory=trio.Event)

    async def follow(self, process: trio.Process) -> None:
        """Until the process has ended."""
        assert process.stdout is not None
        rest = b""
        while more := await process.stdout.receive_some():
            *lines, rest = (rest + more).split(b"\n")
            for line in lines:
                said = json.loads(line)
                self.seconds, self.cpu_s, self.seen = said["seconds"], said["cpu_s"], said["seen"]
                self.has_begun.set()
        if not self.has_begun.is_set():
            raise RuntimeError("the attacker ended before it had begun")


@asynccontextmanager
async def attacking(settings: dict[str, Any]) -> AsyncIterator[Report]:
    """`settings` as for `python -m scenectl.attacks`. Begins when the attack does: an interpreter takes a second to start, or five."""
    report = Report()
    command = [sys.executable, "-m", "scenectl.attacks", json.dumps(settings)]
    process = await trio.lowlevel.open_process(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert process.stdin is not None and process.stdout is not None
    try:
        async with trio.open_nursery() as nursery:
            nursery.start_soon(report.follow, process)
            with trio.fail_after(BEGIN_S_MAX):
                await report.has_begun.wait()
            yield report
            await process.stdin.aclose()
            with trio.fail_after(END_S_MAX):
                await process.wait()
    finally:
        if process.returncode is None:
            process.kill()
        with trio.CancelScope(shield=True):
            await process.wait()
            await process.stdin.aclose()
            await process.stdout.aclose()
