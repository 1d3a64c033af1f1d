"""Nodes as processes that were forked (warm_scenectl.py) in place of started: what node/process.py needs of a process."""

from __future__ import annotations

import os
import signal
import socket
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import IO

import trio

from integration.warm_scenectl import warm


class WarmProcess:
    """As much of `trio.Process` as is used of a node."""

    def __init__(self, pid: int, answer: socket.socket, stdin: trio.lowlevel.FdStream, stdout: trio.lowlevel.FdStream) -> None:
        self.pid = pid
        self.stdin = stdin
        self.stdout = stdout
        self.returncode: int | None = None
        self._answer = answer
        self._turn = trio.Lock()
        with suppress(ProcessLookupError):
            # Its number may be another's once it has ended; this is nobody else's.
            self._handle: int | None = None
            self._handle = os.pidfd_open(pid)

    async def wait(self) -> int:
        async with self._turn:
            if self.returncode is None:
                await trio.lowlevel.wait_readable(self._answer)
                self.returncode = int(self._answer.recv(64))
                self._answer.close()
                if self._handle is not None:
                    os.close(self._handle)
                    self._handle = None
        return self.returncode

    def terminate(self) -> None:
        self._send(signal.SIGTERM)

    def kill(self) -> None:
        self._send(signal.SIGKILL)

    def _send(self, number: signal.Signals) -> None:
        if self._handle is not None:
            with suppress(ProcessLookupError):
                signal.pidfd_send_signal(self._handle, number)


async def open_warm_process(command: Sequence[str], *, stderr: IO[bytes], **_streams_and_session: object) -> WarmProcess:
    """Like `trio.lowlevel.open_process`, for `python -m MODULE …`, with pipes for stdin and stdout, and a session of its own."""
    assert list(command[:2]) == [sys.executable, "-m"], command
    _, _, module, *arguments = command
    theirs_in, ours_in = os.pipe()
    ours_out, theirs_out = os.pipe()
    try:
        # The first of them is waited for until all is imported.
        started = await trio.to_thread.run_sync(warm().start, module, arguments, dict(os.environ), (theirs_in, theirs_out, stderr.fileno()))
    finally:
        os.close(theirs_in)
        os.close(theirs_out)
    started.answer.setblocking(False)
    return WarmProcess(*started, trio.lowlevel.FdStream(ours_in), trio.lowlevel.FdStream(ours_out))
