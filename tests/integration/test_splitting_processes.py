"""If this fails, a record that is split by processes is lost in parts when a node or whoever splits it is killed, or cannot be put together again."""

from __future__ import annotations

import random
import subprocess
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
import trio

from integration.scenectl_process import Done, command, environment, scenectl
from loopback import addresses, free_ports
from scenefold.client import Space, connect
from scenefold.client.tidying import Tidied
from scenefold.node.local import LocalCluster, local_cluster
from scenefold.scene.layout import FILES

COUNT = 4
FEW, MANY = 8, 200
PATIENCE_S = 30.0

pytestmark = pytest.mark.slow


class Bench:
    """A space of a scene on processes, and scenectl as its owner runs it."""

    def __init__(self, nodes: LocalCluster, space: Space, folder: Path) -> None:
        self.nodes, self.space, self.folder = nodes, space, folder
        self.payloads = {place: random.Random(place).randbytes(50_000) for place in ("0a", "0b")}

    async def run(self, *arguments: str) -> Done:
        scene = ("--scene", "kitchen", "--json")
        return await trio.to_thread.run_sync(lambda: scenectl(*arguments, *scene, profile=self.nodes.profile))

    async def done(self, *arguments: str) -> Done:
        done = await self.run(*arguments)
        assert done.code == 0, done.err
        return done

    async def put(self, place: str) -> None:
        file = self.folder / place
        file.write_bytes(self.payloads[place])
        await self.done("data", "put", "files", place, str(file))

    async def check(self) -> None:
        """What was put is read at its own place, and nothing else is listed."""
        listed = (await self.done("data", "ls", "files")).json["locations"]
        assert [place.rstrip("0") for place in listed] == sorted(self.payloads)
        await self.check_reads()

    async def check_reads(self) -> None:
        for place, payload in self.payloads.items():
            file = self.folder / "read"
            file.unlink(missing_ok=True)
            await self.done("data", "get", "files", place, "--output", str(file))
            assert file.read_bytes() == payload, place

    async def killed(self, *arguments: str, once: Callable[[Tidied], bool]) -> None:
        """Begin a command in a process of its own, and kill that when it has come so far, if it is not at its end by then."""
        words, env = command(*arguments, "--scene", "kitchen", "--json"), environment(self.nodes.profile)
        async with trio.open_nursery() as nursery:
            run = partial(trio.run_process, words, check=False, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=env)
            process = await nursery.start(run)
            with trio.fail_after(PATIENCE_S):
                while process.poll() is None and not once(await self.space.tidy(dry_run=True)):
                    await trio.lowlevel.checkpoint()
            process.kill()


@pytest.mark.timeout(300)
async def test_a_split_record_outlives_a_node_and_whoever_splits_or_merges_it(tmp_path: Path) -> None:
    ports = free_ports(addresses(COUNT))
    async with local_cluster(COUNT, tmp_path / "nodes", ports=ports) as nodes, connect(nodes.profile) as cluster:
        scene = await cluster.scenes.create("kitchen")
        bench = Bench(nodes, scene.space(FILES), tmp_path)
        for place in bench.payloads:
            await bench.put(place)
        split = (await bench.done("data", "split", "files", "0a", "--parts", str(FEW))).json
        assert (split["changed"], split["cut"], len(split["parts"])) == (True, "bytes", FEW)
        await bench.check()
        # Not the voter, and of three copies one.
        dead = nodes.addresses[-1]
        await nodes.kill(dead)
        await bench.check_reads()
        nodes.start(dead)
        await nodes.wait([dead])
        await a_killed_split_is_gone_on_with(bench)
        await a_killed_merge_is_gone_on_with(bench)
        refused = await bench.run("data", "split", "files", "0c")
        assert "0c" in refused.refusal(1)


async def a_killed_split_is_gone_on_with(bench: Bench) -> None:
    await bench.killed("data", "split", "files", "0b", "--parts", str(MANY), once=lambda told: told.pending + told.in_use > FEW)
    await bench.check()
    parts = (await bench.done("data", "split", "files", "0b", "--parts", str(MANY))).json["parts"]
    again = (await bench.done("data", "split", "files", "0b", "--parts", str(MANY))).json
    assert again["parts"] == parts and len(parts) == MANY and not again["changed"]
    await bench.done("space", "tidy", "files")
    assert (await bench.space.tidy(dry_run=True)).in_use == FEW + MANY
    await bench.check()


async def a_killed_merge_is_gone_on_with(bench: Bench) -> None:
    await bench.killed("data", "merge", "files", "0b", once=lambda told: told.in_use < FEW + MANY)
    await bench.check()
    for place in bench.payloads:
        await bench.done("data", "merge", "files", place)
    await bench.done("space", "tidy", "files")
    left = await bench.space.tidy(dry_run=True)
    assert (left.in_use, left.pending, left.left_over, left.orphaned) == (0, 0, 0, 0)
    await bench.check()
