"""A cluster of etcd on this machine, to be measured beside: members at 127.0.0.2 and up, with durable writes as they come.

Nothing is installed: the program is named by whoever measures, and everything lies in one folder.
"""

from __future__ import annotations

import base64
import http.client
import json
import os
import socket
import ssl
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

START_S_MAX = 60.0
REQUEST_S_MAX = 5.0
TRY_S = 0.5
"""For one try while there may be no leader: a member that has none keeps whoever asks waiting for seconds."""
LOOK_S = 0.05
LOG_LINES_SHOWN = 3
HOW_TO_HAVE_IT = "on Debian: apt-get download etcd-server; dpkg-deb -x etcd-server_*.deb FOLDER; then --etcd FOLDER/usr/bin/etcd"


class CannotBe(Exception):
    """Why there is no etcd here: to be told, and no fault of what is measured."""


def version_of(program: Path) -> str:
    """What it says of itself; CannotBe if it does not run."""
    try:
        done = subprocess.run([str(program), "--version"], capture_output=True, text=True, check=False)
    except OSError as problem:
        raise CannotBe(f"{program} does not run: {problem.strerror}; {HOW_TO_HAVE_IT}") from problem
    if done.returncode:
        raise CannotBe(f"{program} --version ended with {done.returncode}")
    return done.stdout.partition("\n")[0].rpartition(" ")[2]


@dataclass
class Member:
    """One of them, and how to ask it."""

    name: str
    host: str
    client_port: int
    peer_port: int
    scheme: str
    process: subprocess.Popen[bytes] | None = field(default=None, repr=False)

    @property
    def client_url(self) -> str:
        return f"{self.scheme}://{self.host}:{self.client_port}"

    @property
    def peer_url(self) -> str:
        return f"{self.scheme}://{self.host}:{self.peer_port}"

    def asked(self, timeout_s: float = REQUEST_S_MAX) -> Asked:
        return Asked(self, timeout_s)

    def cpu_s(self) -> float:
        """Processor seconds so far."""
        assert self.process is not None
        words = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


class Asked:
    """A connection to a member, by its gateway of JSON; made anew after it broke."""

    def __init__(self, member: Member, timeout_s: float) -> None:
        self._member, self._timeout_s = member, timeout_s
        self._connection: http.client.HTTPConnection | None = None

    def put(self, key: str, value: bytes) -> None:
        """Return once it is durable at a majority; OSError or HTTPException if it was not acknowledged."""
        self._ask("/v3/kv/put", {"key": base64.b64encode(key.encode()).decode(), "value": base64.b64encode(value).decode()})

    def leader(self) -> str:
        """The id of the leader that it knows."""
        return str(self._ask("/v3/maintenance/status", {}).get("leader", "0"))

    def own_id(self) -> str:
        header = self._ask("/v3/maintenance/status", {})["header"]
        assert isinstance(header, dict)
        return str(header["member_id"])

    def close(self) -> None:
        if self._connection is not None:
            self._connection.close()
            self._connection = None

    def _ask(self, path: str, body: dict[str, str]) -> dict[str, object]:
        connection = self._connection = self._connection or self._connected()
        try:
            connection.request("POST", path, json.dumps(body).encode(), {"Content-Type": "application/json"})
            answer = connection.getresponse()
            said = answer.read()
        except (OSError, http.client.HTTPException):
            self.close()
            raise
        if answer.status != 200:
            raise http.client.HTTPException(f"{path}: {answer.status} {said[:200]!r}")
        found: dict[str, object] = json.loads(said)
        return found

    def _connected(self) -> http.client.HTTPConnection:
        member = self._member
        if member.scheme == "http":
            return http.client.HTTPConnection(member.host, member.client_port, timeout=self._timeout_s)
        # Its certificates are its own, made at its start.
        context = ssl.create_default_context()
        context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
        return http.client.HTTPSConnection(member.host, member.client_port, timeout=self._timeout_s, context=context)


class Members:
    """All of them; made by `running`."""

    def __init__(self, program: Path, folder: Path, members: Sequence[Member]) -> None:
        self._program, self._folder, self.all = program, folder, members
        self._logs = ExitStack()

    def start(self, member: Member) -> None:
        cluster = ",".join(f"{one.name}={one.peer_url}" for one in self.all)
        command = [str(self._program), "--name", member.name, "--data-dir", str(self._folder / member.name)]
        command += ["--listen-client-urls", member.client_url, "--advertise-client-urls", member.client_url]
        command += ["--listen-peer-urls", member.peer_url, "--initial-advertise-peer-urls", member.peer_url]
        command += ["--initial-cluster", cluster, "--initial-cluster-state", "new"]
        command += ["--auto-tls", "--peer-auto-tls"] if member.scheme == "https" else []
        log = self._logs.enter_context((self._folder / f"{member.name}.log").open("ab"))
        member.process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=log, stderr=log)

    def kill(self, member: Member) -> None:
        """Without warning."""
        assert member.process is not None
        member.process.kill()
        member.process.wait()

    def leader(self) -> Member:
        """Who leads, once all agree; CannotBe if that takes long."""
        end = time.monotonic() + START_S_MAX
        while time.monotonic() < end:
            for member in self.all:
                if member.process is not None and member.process.poll() is not None:
                    said = (self._folder / f"{member.name}.log").read_text(errors="replace").splitlines()
                    raise CannotBe(f"{member.name} ended: " + " ".join(said[-LOG_LINES_SHOWN:]))
            with suppress(OSError, http.client.HTTPException, KeyError, ValueError):
                asked = [member.asked() for member in self.all]
                leaders = {one.leader() for one in asked}
                ids = {one.own_id(): member for one, member in zip(asked, self.all, strict=True)}
                for one in asked:
                    one.close()
                if len(leaders) == 1 and (leader := ids.get(leaders.pop())) is not None:
                    return leader
            time.sleep(LOOK_S)
        raise CannotBe(f"its members did not agree on a leader within {START_S_MAX:g} s")

    def cpu_s(self) -> float:
        return sum(member.cpu_s() for member in self.all)

    def end(self) -> None:
        for member in self.all:
            if member.process is not None:
                member.process.kill()
                member.process.wait()
        self._logs.close()


@contextmanager
def running(program: Path, folder: Path, count: int, *, tls: bool) -> Iterator[Members]:
    """So many members that have a leader; none of them is left afterwards."""
    hosts = [f"127.0.0.{number + 2}" for number in range(count)]
    scheme = "https" if tls else "http"
    found = [Member(f"m{number}", host, free_port(host), free_port(host), scheme) for number, host in enumerate(hosts)]
    members = Members(program, folder, found)
    try:
        for member in found:
            members.start(member)
        members.leader()
        yield members
    finally:
        members.end()


def until_put(others: Sequence[Member], put: Callable[[Asked], None]) -> None:
    """Return once one of these, in turns, acknowledges."""
    asked = [member.asked(TRY_S) for member in others]
    turn = 0
    while True:
        try:
            put(asked[turn % len(asked)])
            return
        except (OSError, http.client.HTTPException):
            turn += 1
            time.sleep(LOOK_S / 5)


def free_port(host: str) -> int:
    with socket.socket() as one:
        one.bind((host, 0))
        port: int = one.getsockname()[1]
        return port
