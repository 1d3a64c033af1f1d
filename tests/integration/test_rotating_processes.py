"""If this fails, a scene whose key changes cannot be read or written meanwhile, or a rotation that was killed does not go on.

SCENEFOLD_FULL_SIZE=1 runs it as docs/benchmarks.md quotes it: 1 GiB in records of 60 KiB (with -s it prints its figures).
"""

from __future__ import annotations

import json
import os
import random
import re
import signal
import subprocess
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
import trio

from integration.scenectl_process import command, environment
from loopback import addresses, free_ports
from scenefold.base.location import LINE_LENGTH, Location
from scenefold.client import Space, connect
from scenefold.node.local import local_cluster
from scenefold.scene.layout import FILES

NODES = 3
BATCH = 200
LOOK_S = 0.05


@dataclass(frozen=True)
class Size:
    records: int
    payload_bytes: int
    rate: tuple[str, ...]
    """So slow that it can be killed in its midst."""


SMALL = Size(4_000, 2_000, ("--rate", "1"))
FULL = Size(17_477, 61_440, ())

pytestmark = pytest.mark.slow


@dataclass
class People:
    """Who reads and writes all the while. Each place has a version that was acknowledged, and one that was tried."""

    space: Space
    size: Size
    places: list[Location] = field(init=False)
    written: list[int] = field(init=False)
    tried: list[int] = field(init=False)
    reads: int = 0
    writes: int = 0
    slowest_s: float = 0.0

    def __post_init__(self) -> None:
        count = self.size.records
        self.places = [Location.from_number(LINE_LENGTH * (2 * index + 1) // (2 * count)) for index in range(count)]
        self.written, self.tried = [0] * count, [0] * count
        self._dice = random.Random(4)

    def payload(self, index: int, version: int) -> bytes:
        return random.Random(f"{index} {version}").randbytes(self.size.payload_bytes)

    async def fill(self) -> None:
        for start in range(0, len(self.places), BATCH):
            numbers = range(start, min(start + BATCH, len(self.places)))
            await self.space.put_many([(self.places[index], self.payload(index, 0)) for index in numbers])

    async def go_on_writing(self) -> None:
        while True:
            index = self._dice.randrange(len(self.places))
            version = self.tried[index] = self.tried[index] + 1
            begun = trio.current_time()
            await self.space.put(self.places[index], self.payload(index, version))
            self.written[index] = version
            self.writes += 1
            self.slowest_s = max(self.slowest_s, trio.current_time() - begun)
            await trio.sleep(0.02)

    async def go_on_reading(self) -> None:
        while True:
            await self.read(self._dice.sample(range(len(self.places)), 4))
            await trio.sleep(0.02)

    async def read(self, numbers: list[int]) -> None:
        least, begun = [self.written[index] for index in numbers], trio.current_time()
        found = await self.space.get_many([self.places[index] for index in numbers])
        self.slowest_s = max(self.slowest_s, trio.current_time() - begun)
        for index, low, payload in zip(numbers, least, found, strict=True):
            assert payload in [self.payload(index, version) for version in range(low, self.tried[index] + 1)], f"record {index}"
        self.reads += len(numbers)

    async def check(self) -> None:
        for start in range(0, len(self.places), BATCH):
            await self.read(list(range(start, min(start + BATCH, len(self.places)))))


class Rotation:
    """`scenectl scene rotate-key` as a process, what it says, and the most memory that it had."""

    def __init__(self, profile: Path, *options: str) -> None:
        self._arguments = command("scene", "rotate-key", "kept", *options)
        self._env = environment(profile)
        self.said: list[str] = []
        self.most_mib = 0.0
        self.seconds = 0.0
        self.code = 0
        self.out = b""

    async def run(self, kill_at: float | None = None) -> None:
        """To its end, or until so large a part of the records is done."""
        begun = trio.current_time()
        process = await trio.lowlevel.open_process(self._arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=self._env)
        async with process.stdout, process.stderr, trio.open_nursery() as nursery:  # type: ignore[union-attr]
            nursery.start_soon(self._listen, process, kill_at)
            nursery.start_soon(self._collect, process)
            nursery.start_soon(self._weigh, process)
            self.code = await process.wait()
        self.seconds = trio.current_time() - begun

    async def _listen(self, process: trio.Process, kill_at: float | None) -> None:
        rest = b""
        async for part in process.stderr:  # type: ignore[union-attr]
            *lines, rest = (rest + part).split(b"\n")
            self.said += [line.decode() for line in lines]
            shown = re.match(r"re-encrypt: (\d+) of (\d+)", self.said[-1]) if self.said else None
            if kill_at is not None and shown and int(shown[1]) >= kill_at * int(shown[2]):
                process.send_signal(signal.SIGKILL)
        if rest:
            self.said.append(rest.decode())

    async def _collect(self, process: trio.Process) -> None:
        async for part in process.stdout:  # type: ignore[union-attr]
            self.out += part

    async def _weigh(self, process: trio.Process) -> None:
        while process.poll() is None:
            self.most_mib = max(self.most_mib, _most_mib(process.pid))
            await trio.sleep(LOOK_S)


def _most_mib(pid: int) -> float:
    """The most memory that a process had so far."""
    try:
        found = re.search(r"VmHWM:\s+(\d+) kB", Path(f"/proc/{pid}/status").read_text())
    except FileNotFoundError:
        return 0.0
    return int(found[1]) / 1024 if found else 0.0


@pytest.mark.timeout(3000)
@pytest.mark.long
async def test_a_rotation_that_is_killed_goes_on_and_nobody_notices(tmp_path: Path) -> None:
    size = FULL if os.environ.get("SCENEFOLD_FULL_SIZE") == "1" else SMALL
    ports = free_ports(addresses(NODES))
    async with local_cluster(NODES, tmp_path, ports=ports) as nodes, connect(nodes.profile) as cluster:
        scene = await cluster.scenes.create("kept")
        people = People(scene.space(FILES), size)
        begun = trio.current_time()
        await people.fill()
        seconds = {"put": trio.current_time() - begun}
        first, second = Rotation(nodes.profile, *size.rate), Rotation(nodes.profile, "--resume", "--json")
        async with trio.open_nursery() as nursery:
            nursery.start_soon(people.go_on_writing)
            nursery.start_soon(people.go_on_reading)
            await first.run(kill_at=0.4)
            assert first.code == -signal.SIGKILL, first.said
            await second.run()
            assert second.code == 0, second.said
            nursery.cancel_scope.cancel()
        report = json.loads(second.out)
        assert report["key_epoch"] == 1 and report["unreadable"] == 0
        assert 0 < report["renewed"] < size.records, "what was done before stayed done, and not all of it was"
        left = await scene.reencrypt()
        assert (left.renewed, left.unreadable, left.walked) == (0, 0, size.records)
        seconds |= {"rotate until killed": first.seconds, "resume to the end": second.seconds, "one walk that finds nothing": left.seconds}
        worked = people.reads, people.writes
        await people.check()
    assert any(" left" in line for line in first.said), "people are told how long it takes"
    assert people.writes > 10 and people.reads > 40
    print(json.dumps(figures(size, seconds, report, first, second, worked, people)))


def figures(
    size: Size,
    seconds: dict[str, float],
    report: dict[str, Any],
    first: Rotation,
    second: Rotation,
    worked: tuple[int, int],
    people: People,
) -> dict[str, Any]:
    return {
        "mib": round(size.records * size.payload_bytes / 2**20, 1),
        "seconds": {name: round(value, 1) for name, value in seconds.items()},
        "resumed": report,
        "most_mib_of_memory": [round(first.most_mib), round(second.most_mib)],
        "last_word": first.said[-1],
        "read_meanwhile": worked[0],
        "written_meanwhile": worked[1],
        "slowest_s": round(people.slowest_s, 2),
    }
