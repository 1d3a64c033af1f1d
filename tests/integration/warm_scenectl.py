"""A process that has imported what scenectl and nodes consist of, and forks one for each: tests run hundreds, and to import takes most of the time of each.

A command has a process of its own here as well, with its own arguments, environment, folder and streams, and runs `scenectl.__main__`
from its first line to the end of its interpreter. That it says and does the same as one that was started from nothing is tested
(test_warm_scenectl.py); that those start is for the tests of verbs that go on running, whose processes are made anew. So it is with a node (warm_nodes.py):
`scenectl node run` and `node local` start theirs from nothing, as users do.
"""

from __future__ import annotations

import atexit
import functools
import gc
import importlib
import json
import os
import runpy
import selectors
import signal
import socket
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

MESSAGE_BYTES_MAX = 150_000
IMPORTED = (
    "numpy",
    "rich.progress",
    "tomlkit",
    "scenectl.program",
    "scenectl.running",
    "scenefold.client.cluster",
    "scenefold.client.connecting",
    "scenefold.node.local",
    "scenefold.node.program",
    "scenefold.world.real",
)
"""And all groups of verbs. Nothing that has threads, or that looks at the environment as it is imported (numba)."""

COMMAND = "scenectl"
"""Any other program is a module, and gets a session of its own."""

Streams = tuple[int, int, int]


class Started(NamedTuple):
    """A process that was forked. Its exit code, as subprocess has it, comes as digits."""

    pid: int
    answer: socket.socket


class Warm:
    """Our end: the process that forks."""

    def __init__(self) -> None:
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        # A process with threads must not fork.
        env = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
        with theirs:
            self._process = subprocess.Popen([sys.executable, __file__], stdin=theirs, env=env)
        atexit.register(self._end)

    def run(self, arguments: Sequence[str], env: dict[str, str], streams: Streams, limit_s: float) -> int:
        """The exit code of a command, as subprocess has it; TimeoutExpired, once it was killed."""
        pid, answer = self.start(COMMAND, arguments, env, streams)
        with answer:
            answer.settimeout(limit_s)
            try:
                return int(answer.recv(64))
            except BaseException as error:
                os.kill(pid, signal.SIGKILL)
                answer.settimeout(None)
                answer.recv(64)
                if isinstance(error, TimeoutError):
                    raise subprocess.TimeoutExpired(list(arguments), limit_s) from None
                raise

    def start(self, program: str, arguments: Sequence[str], env: dict[str, str], streams: Streams) -> Started:
        """COMMAND, or a module, as a process of its own."""
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            request = json.dumps([program, list(arguments), env, str(Path.cwd())], ensure_ascii=True).encode()
            assert len(request) <= MESSAGE_BYTES_MAX
            socket.send_fds(self._socket, [request], [*streams, theirs.fileno()])
        return Started(int(ours.recv(64)), ours)

    def _end(self) -> None:
        self._socket.close()
        self._process.wait()


@functools.cache
def warm() -> Warm:
    """That of this process of tests."""
    return Warm()


class _Order:
    """A command that was sent, at the other end."""

    def __init__(self, request: bytes, descriptors: list[int]) -> None:
        self.program, self.arguments, self.env, self.folder = json.loads(request)
        *self.streams, self.answer = descriptors

    def close(self) -> None:
        for descriptor in (*self.streams, self.answer):
            os.close(descriptor)


def _serve(control: socket.socket) -> _Order | None:
    """Fork for each order. Returns it in the process that is to obey, and None where nobody orders any more."""
    with selectors.DefaultSelector() as looking:
        looking.register(control, selectors.EVENT_READ)
        while True:
            for key, _ in looking.select():
                if key.fileobj is not control:
                    pid, answer = key.data
                    code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
                    looking.unregister(key.fileobj)
                    os.close(key.fd)
                    _tell(answer, code)
                    os.close(answer)
                    continue
                request, descriptors, _, _ = socket.recv_fds(control, MESSAGE_BYTES_MAX, 4)
                if not request:
                    return None
                order = _Order(request, descriptors)
                pid = os.fork()
                if pid == 0:
                    return order
                _tell(order.answer, pid)
                looking.register(os.pidfd_open(pid), selectors.EVENT_READ, (pid, os.dup(order.answer)))
                order.close()


def _tell(answer: int, number: int) -> None:
    try:
        os.write(answer, b"%d" % number)
    except BrokenPipeError:
        return  # who asked has gone


def _become(order: _Order) -> None:
    """What the interpreter does for a process before its first line."""
    for number, stream in enumerate(order.streams):
        os.dup2(stream, number)
    order.close()
    os.environ.clear()
    os.environ.update(order.env)
    os.chdir(order.folder)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.argv = [order.program, *order.arguments]
    sys.path[:0] = [path for path in order.env.get("PYTHONPATH", "").split(os.pathsep) if path and path not in sys.path]
    sys.stdin = open(0, encoding="utf-8", closefd=False)  # noqa: SIM115 - the process's own
    sys.stdout = open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
    sys.stderr = open(2, "w", buffering=1, encoding="utf-8", errors="backslashreplace", closefd=False)  # noqa: SIM115


def _main() -> int:
    # This file's folder is no place to import from.
    del sys.path[0]
    # Ctrl-C is for who runs the tests; that ends us as well.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for name in IMPORTED:
        importlib.import_module(name)
    from scenectl.program import GROUPS

    for name in GROUPS:
        importlib.import_module(f"scenectl.{name}")
    gc.collect()
    gc.freeze()
    with socket.socket(fileno=os.dup(0)) as control:
        order = _serve(control)
    if order is None:
        return 0
    _become(order)
    if order.program == COMMAND:
        from scenectl.__main__ import main

        return main()
    os.setsid()
    runpy.run_module(order.program, run_name="__main__", alter_sys=True)
    return 0


if __name__ == "__main__":
    sys.exit(_main())
