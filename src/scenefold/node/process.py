"""One node as a child process: started, listened to, ended; nothing of it is left behind, however we end."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import AsyncIterator, Sequence
from pathlib import Path
from typing import Any

import trio

from scenefold.base.errors import LocalFault, ScenefoldError, Unreachable, UsageFault

STOP_S_MAX = 10.0
"""From SIGTERM to SIGKILL: a store's last commit and a kernel's last call take about one second."""
EVENT_BYTES_MAX = 64 * 1024
_UNREACHABLE = 3
_WRONG_USAGE = 2
open_process = trio.lowlevel.open_process
_EVERYDAY = ("[debug", "[info", '"level": "debug"', '"level": "info"')
"""How lines of little weight look in both forms of logs (logs.py)."""


class NodeEnded(Exception):
    """A node ended without being told to. `error` says why, in the node's own words if it had any."""

    def __init__(self, error: ScenefoldError) -> None:
        super().__init__(str(error))
        self.error = error


class NodeProcess:
    """A node at an address of this machine. `run` it in a task; `ready`, `joined` and `ended` say how it stands."""

    def __init__(self, address: str, arguments: Sequence[str], log: Path, module: str = "scenefold.node") -> None:
        self.address = address
        self.log = log
        self.pid: int | None = None
        self.ready = trio.Event()
        self.joined = trio.Event()
        self.ended = trio.Event()
        self._command = [sys.executable, "-m", module, "--stop-with-parent", *arguments]
        self._process: trio.Process | None = None
        self._failure: dict[str, Any] | None = None
        self._expected_end = False

    async def run(self) -> None:
        """Run the node until it ends or we are cancelled. Its own error, if it ended without being told to."""
        with self.log.open("ab") as log:
            # A session of its own: Ctrl-C in a terminal reaches us alone, and we end the nodes in order.
            process = await open_process(
                self._command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log,
                start_new_session=True,
            )
        self._process, self.pid = process, process.pid
        try:
            await self._listen(process)
            await process.wait()
        finally:
            with trio.CancelScope(shield=True):
                await self._end(process)
            self.ended.set()
        if not self._expected_end:
            raise NodeEnded(self._error(process.returncode))

    async def stop(self) -> None:
        """Tell the node to stop (SIGTERM) and wait until it has."""
        self._expected_end = True
        if self._process is not None:
            self._process.terminate()
        await self.ended.wait()

    async def kill(self) -> None:
        """Let the node die without warning (SIGKILL), as in a power cut."""
        self._expected_end = True
        if self._process is not None:
            self._process.kill()
        await self.ended.wait()

    def crash(self) -> None:
        """The same, but nobody expects it: `run` ends as with a node that dies by itself."""
        if self._process is not None:
            self._process.kill()

    def expect_end(self) -> None:
        """However it ends from now on, it is no error."""
        self._expected_end = True

    async def _listen(self, process: trio.Process) -> None:
        assert process.stdout is not None
        async for event in _events(process.stdout):
            match event.get("event"):
                case "ready":
                    self.ready.set()
                case "joined":
                    self.joined.set()
                case "left":
                    self._expected_end = True
                case "failed":
                    self._failure = event

    async def _end(self, process: trio.Process) -> None:
        if process.returncode is None:
            process.terminate()
            with trio.move_on_after(STOP_S_MAX):
                await process.wait()
        if process.returncode is None:
            process.kill()
            await process.wait()
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                await pipe.aclose()

    def _error(self, code: int | None) -> ScenefoldError:
        """The node's own words, or what can be said of a node that died without any."""
        if self._failure is None:
            words = f": {last_line}" if (last_line := _last_line(self.log)) else ""
            remedy = "run it again; SIGKILL often means that memory ran out" if code == -signal.SIGKILL else "its log may say more"
            return LocalFault(f"node {self.address} ended unexpectedly ({_ending(code)}){words}", where=str(self.log), remedy=remedy)
        verb = "ended" if self.ready.is_set() else "cannot run"
        what = f"node {self.address} {verb}: {self._failure.get('what', '')}"
        where, remedy = str(self._failure.get("where", "")), str(self._failure.get("remedy", ""))
        kinds = {_UNREACHABLE: Unreachable, _WRONG_USAGE: UsageFault}
        return kinds.get(code or 0, LocalFault)(what, where=where, remedy=remedy)


def _ending(code: int | None) -> str:
    """An exit code for people: that of a process that a signal ended is the signal's number, negative."""
    return signal.Signals(-code).name if code is not None and -code in set(signal.Signals) else f"exit code {code}"


def _last_line(log: Path) -> str:
    """The last thing that the node wrote, unless it is everyday news: with a crash of the interpreter it is all that there is."""
    lines = log.read_bytes()[-EVENT_BYTES_MAX:].decode(errors="replace").strip().splitlines()
    return lines[-1][:500] if lines and not any(level in lines[-1] for level in _EVERYDAY) else ""


async def _events(stdout: trio.abc.ReceiveStream) -> AsyncIterator[dict[str, Any]]:
    """The JSON objects among the lines of a stream; other lines (of libraries that print) are passed over."""
    rest = b""
    async for data in stdout:
        *lines, rest = (rest + data).split(b"\n")
        rest = rest[-EVENT_BYTES_MAX:]
        for line in lines:
            try:
                event = json.loads(line)
            except ValueError:
                continue
            if isinstance(event, dict):
                yield event
