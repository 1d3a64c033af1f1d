"""If this failed, a node that dies would lose what it has acknowledged."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from unit.store.samples import place, record, whole_store, world

WRITER = """
import sys
from pathlib import Path
import trio
sys.path.insert(0, {tests!r})
from scenefold.store import Outcome
from unit.store.samples import put, whole_store, world

async def write(store, start):
    for number in range(start, 1 << 30, 16):
        [result] = await store.put([put(number, size=20_000)])
        assert result.outcome is Outcome.STORED
        sys.stdout.write(f"{{number}}\\n")
        sys.stdout.flush()

async def main():
    async with whole_store(world(), Path({folder!r})) as store:
        async with trio.open_nursery() as nursery:
            for start in range(16):
                nursery.start_soon(write, store, start)

trio.run(main)
"""


def acknowledged_before_kill(folder: Path, count_min: int) -> list[int]:
    """The records that a process acknowledged before it was killed, in the midst of its writing."""
    script = WRITER.format(tests=str(Path(__file__).parents[2]), folder=str(folder))
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True) as writer:
        assert writer.stdout is not None
        acknowledged = [int(writer.stdout.readline()) for _ in range(count_min)]
        writer.kill()
        # The last line may be cut; one that is whole was acknowledged.
        return acknowledged + [int(line) for line in writer.stdout if line.endswith("\n")]


@pytest.mark.parametrize("count_min", [1, 17, 400])
async def test_what_was_acknowledged_before_a_kill_is_there(tmp_path: Path, count_min: int) -> None:
    acknowledged = acknowledged_before_kill(tmp_path, count_min)
    async with whole_store(world(), tmp_path) as store:
        found = await store.get_many([place(number) for number in acknowledged])
        assert found == [record(number, size=20_000) for number in acknowledged]
        statistics = await store.statistics()
    assert statistics.records >= len(acknowledged) >= count_min
