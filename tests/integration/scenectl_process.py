"""scenectl as users run it: a process, with its output, errors and exit code."""

from __future__ import annotations

import json
import os
import re
import select
import subprocess
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

from integration.warm_scenectl import warm

LIMIT_S = 60


@dataclass(frozen=True)
class Done:
    """A command that ended."""

    code: int
    out: bytes
    err: str

    @property
    def json(self) -> Any:
        return json.loads(self.out)

    def refusal(self, code: int) -> str:
        """The error line of a command that ended with this exit code: `error: what (where): remedy`."""
        assert self.code == code, self.err
        assert re.fullmatch(r"error: .+ \(.+\): .+", self.error), self.error
        return self.error

    @property
    def error(self) -> str:
        """The error line; there must be one, and no traceback."""
        lines = [line for line in self.err.splitlines() if line.startswith("error: ")]
        assert len(lines) == 1, self.err
        assert "Traceback" not in self.err
        return lines[0]


def scenectl(*arguments: str | Path, profile: Path | str | None = None, stdin: bytes = b"", limit_s: float = LIMIT_S, **env: str) -> Done:
    """Run one command to its end, in a process that need not import everything first (warm_scenectl.py)."""
    with TemporaryFile() as given, TemporaryFile() as out, TemporaryFile() as err:
        given.write(stdin)
        given.seek(0)
        streams = (given.fileno(), out.fileno(), err.fileno())
        code = warm().run([str(argument) for argument in arguments], environment(profile, **env), streams, limit_s)
        out.seek(0)
        err.seek(0)
        return Done(code, out.read(), err.read().decode())


def scenectl_from_nothing(*arguments: str | Path, profile: Path | str | None = None, stdin: bytes = b"", **env: str) -> Done:
    """The same by an interpreter that is started for it, as users' are."""
    done = subprocess.run(command(*arguments), input=stdin, capture_output=True, timeout=LIMIT_S, env=environment(profile, **env))
    return Done(done.returncode, done.stdout, done.stderr.decode())


def command(*arguments: str | Path) -> list[str]:
    return [sys.executable, "-m", "scenectl", *map(str, arguments)]


def environment(profile: Path | str | None, **more: str) -> dict[str, str]:
    """Ours without any settings of scenefold but these."""
    env = {name: value for name, value in os.environ.items() if not name.startswith("SCENEFOLD_")}
    return env | ({} if profile is None else {"SCENEFOLD_PROFILE": str(profile)}) | more


def children(pid: int) -> dict[str, int]:
    """The node processes of a scenectl, by address."""
    found = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            parent = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
            words = (folder / "cmdline").read_text().split("\0")
        except OSError:  # it ended meanwhile
            continue
        if parent == pid and "--address" in words:
            found[words[words.index("--address") + 1]] = int(folder.name)
    return found


def await_ends(pids: Iterable[int], limit_s: float = LIMIT_S) -> None:
    """Return when none of these processes runs any more; they need not be our children."""
    for pid in pids:
        try:
            handle = os.pidfd_open(pid)
        except ProcessLookupError:
            continue
        try:
            assert select.select([handle], [], [], limit_s)[0], f"process {pid} still runs"
        finally:
            os.close(handle)


@contextmanager
def running(*arguments: str | Path, profile: Path | str | None = None, **more: str) -> Iterator[tuple[subprocess.Popen[bytes], Any]]:
    """A verb that goes on running (with --json): the process, and what it said when it was ready. Ended by SIGINT."""
    with subprocess.Popen(command(*arguments), stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment(profile, **more)) as process:
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            if not line:
                assert process.stderr is not None
                raise AssertionError(process.stderr.read().decode())
            yield process, json.loads(line)
        finally:
            if process.poll() is None:
                process.send_signal(2)
                try:
                    process.communicate(timeout=LIMIT_S)
                except subprocess.TimeoutExpired:
                    process.kill()
                    raise


def await_progress(process: subprocess.Popen[str]) -> None:
    """Return once a render has done a part of its work, and goes on."""
    assert process.stderr is not None
    lines = []
    for line in process.stderr:
        lines.append(line)
        if line.startswith("render: ") and not line.startswith("render: 0 of"):
            break
    assert process.poll() is None, lines
