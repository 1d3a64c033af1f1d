"""A grid of Tahoe-LAFS on this machine, of public tools only, to be measured beside: an introducer, storage nodes, a client.

It is installed into an environment of its own with whatever pip is configured to ask, and everything runs on 127.0.0.1 and in one folder.
"""

from __future__ import annotations

import http.client
import json
import os
import socket
import subprocess
import sys
import time
import urllib.parse
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

VERSION = "1.20.0"
HOST = "127.0.0.1"
START_S_MAX = 120.0
REQUEST_S_MAX = 600.0
LOOK_S = 0.2
LOG_LINES_SHOWN = 5

Result = TypeVar("Result")


class CannotBe(Exception):
    """Why there is no grid here: to be told, and no fault of what is measured."""


class GridFailed(Exception):
    """The grid runs, and did not do what it was asked."""


def installed(environment: Path) -> Path:
    """The program `tahoe` in this environment, installed there if it is not; CannotBe with pip's last words."""
    program = environment / "bin" / "tahoe"
    if not program.exists():
        _run([sys.executable, "-m", "venv", str(environment)])
        _run([str(environment / "bin" / "python"), "-m", "pip", "install", "--quiet", f"tahoe-lafs=={VERSION}"])
    return program


def _run(command: Sequence[str]) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        words = (done.stderr or done.stdout).strip().splitlines()
        said = next((line for line in words if line.startswith("ERROR")), words[-1] if words else "no word why")
        raise CannotBe(f"{' '.join(command[:4])} ... failed: {said}")


@dataclass(frozen=True)
class Grid:
    """A grid that runs, by the address of its client's web interface."""

    host: str
    port: int

    def up(self, data: bytes) -> str:
        """Store a file; the words by which it is found again."""
        return self._asked("PUT", "/uri", data).decode("ascii")

    def down(self, cap: str) -> bytes:
        return self._asked("GET", "/uri/" + urllib.parse.quote(cap, safe=""))

    def servers(self) -> int:
        """Storage nodes that the client is connected to."""
        found = json.loads(self._asked("GET", "/?t=json"))
        return sum(str(server.get("connection_status", "")).lower().startswith("connected") for server in found["servers"])

    def wait_for(self, nodes: int) -> None:
        """Return once the client is connected to so many storage nodes; CannotBe if that takes long."""
        _wait(f"{nodes} storage nodes that the client is connected to", lambda: self.servers() == nodes)

    def many(self, callers: int, calls: Sequence[Callable[[], Result]]) -> tuple[list[Result], float]:
        """Make all calls, so many at a time; what they gave, and how many a second there were."""
        begun = time.monotonic()
        with ThreadPoolExecutor(callers) as pool:
            found = list(pool.map(lambda call: call(), calls))
        return found, len(calls) / (time.monotonic() - begun)

    def _asked(self, method: str, path: str, body: bytes | None = None) -> bytes:
        connection = http.client.HTTPConnection(self.host, self.port, timeout=REQUEST_S_MAX)
        try:
            connection.request(method, path, body)
            answer = connection.getresponse()
            said = answer.read()
        finally:
            connection.close()
        if answer.status not in (200, 201):
            raise GridFailed(f"{method} {path[:40]}: {answer.status} {said[:200]!r}")
        return said


@contextmanager
def grid(tahoe: Path, folder: Path, nodes: int, total: int, needed: int, happy: int) -> Iterator[Grid]:
    """So many storage nodes, and a client that makes `total` shares of which `needed` are needed; none of them is left afterwards."""
    with ExitStack() as stack:

        def made(kind: str, name: str, *options: str) -> Path:
            place = folder / name
            _run([str(tahoe), kind, *options, str(place)])
            return place

        def started(place: Path) -> None:
            stack.enter_context(_running(tahoe, place))

        introducer = made("create-introducer", "introducer", *_listening(_free_port()))
        started(introducer)
        furl = _text(introducer / "private" / "introducer.furl")
        for number in range(nodes):
            name = f"storage{number}"
            started(made("create-node", name, "--nickname", name, "--introducer", furl, "--webport", "none", *_listening(_free_port())))
        shares = [f"--shares-total={total}", f"--shares-needed={needed}", f"--shares-happy={happy}"]
        client = made("create-client", "client", "--introducer", furl, "--webport", f"tcp:{_free_port()}:interface={HOST}", *shares)
        started(client)
        url = urllib.parse.urlsplit(_text(client / "node.url"))
        assert url.hostname and url.port
        found = Grid(url.hostname, url.port)
        found.wait_for(nodes)
        yield found


def _listening(port: int) -> list[str]:
    return [f"--port=tcp:{port}:interface={HOST}", f"--location=tcp:{HOST}:{port}"]


@contextmanager
def _running(tahoe: Path, place: Path) -> Iterator[None]:
    log = place / "output.log"
    with log.open("wb") as output:
        # It runs until its standard input is closed: so it ends with us, too.
        process = subprocess.Popen(
            [str(tahoe), "run", str(place)],
            stdin=subprocess.PIPE,
            stdout=output,
            stderr=subprocess.STDOUT,
            env=os.environ | {"HOME": str(place)},
        )
    try:
        yield
        if process.poll() is not None:
            raise CannotBe(f"{place.name} ended: " + " ".join(log.read_text(errors="replace").splitlines()[-LOG_LINES_SHOWN:]))
    finally:
        assert process.stdin is not None
        process.stdin.close()
        process.terminate()
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _text(path: Path) -> str:
    """What a node writes once it runs."""
    _wait(f"{path.parent.name}/{path.name}", lambda: path.exists() and path.read_text().strip() != "")
    return path.read_text().strip()


def _wait(what: str, is_so: Callable[[], bool]) -> None:
    end = time.monotonic() + START_S_MAX
    problem = ""
    while time.monotonic() < end:
        try:
            if is_so():
                return
        except (OSError, GridFailed, ValueError, KeyError) as error:
            problem = f": {error}"
        time.sleep(LOOK_S)
    raise CannotBe(f"waited {START_S_MAX:g} s in vain for {what}{problem}")


def _free_port() -> int:
    with socket.socket() as one:
        one.bind((HOST, 0))
        port: int = one.getsockname()[1]
        return port
