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
    """What an attack did; filled when it has ended."""

    seconds: float = 0.0
    cpu_s: float = 0.0
    seen: dict[str, int] = field(default_factory=dict)


@asynccontextmanager
async def attacking(settings: dict[str, Any]) -> AsyncIterator[Report]:
    """`settings` as for `python -m scenectl.attacks`. Begins when the attack does: an interpreter takes a second to start, or five."""
    report = Report()
    command = [sys.executable, "-m", "scenectl.attacks", json.dumps(settings)]
    process = await trio.lowlevel.open_process(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert process.stdin is not None and process.stdout is not None
    try:
        said = b""
        with trio.fail_after(BEGIN_S_MAX):
            while b"\n" not in said:
                said += await _more(process.stdout)
        yield report
        await process.stdin.aclose()
        with trio.fail_after(END_S_MAX):
            while more := await process.stdout.receive_some():
                said += more
            await process.wait()
        found = json.loads(said.partition(b"\n")[2])
        report.seconds, report.cpu_s, report.seen = found["seconds"], found["cpu_s"], found["seen"]
    finally:
        if process.returncode is None:
            process.kill()
        with trio.CancelScope(shield=True):
            await process.wait()
            await process.stdin.aclose()
            await process.stdout.aclose()


async def _more(stream: trio.abc.ReceiveStream) -> bytes:
    data = await stream.receive_some()
    if not data:
        raise RuntimeError("the attacker ended before it had begun")
    return bytes(data)
