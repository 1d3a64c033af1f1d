"""If this fails, a scene that was ended goes on at some process, or its data stays on disks, or comes back with who was away."""

from __future__ import annotations

from pathlib import Path

import pytest
import trio

from integration.scenectl_process import Done, scenectl
from loopback import addresses, free_ports
from scenefold.base.ids import SceneId
from scenefold.client import Cluster, connect
from scenefold.client.reports import NodeReport
from scenefold.node.local import LocalCluster, local_cluster
from scenefold.store import LmdbDisk
from scenefold.store.layout import HEADERS, LOGS, RECORDS, TABLES, scene_key

COUNT = 4
PATIENCE_S, LOOK_S = 120.0, 0.5

pytestmark = pytest.mark.slow


class Estate:
    """Processes, and scenectl as the owner of a scene runs it."""

    def __init__(self, nodes: LocalCluster, cluster: Cluster) -> None:
        self.nodes, self.cluster = nodes, cluster

    async def run(self, *arguments: str) -> Done:
        return await trio.to_thread.run_sync(lambda: scenectl(*arguments, "--json", profile=self.nodes.profile))

    async def done(self, *arguments: str) -> Done:
        done = await self.run(*arguments)
        assert done.code == 0, done.err
        return done

    async def restart(self, *dead: str) -> None:
        for address in dead:
            self.nodes.start(address)
        await self.nodes.wait(dead)

    async def until_nothing_is_held(self) -> None:
        """By the word of all nodes."""
        with trio.fail_after(PATIENCE_S):
            while True:
                told = await self.cluster.reports(self.nodes.addresses)
                if all(isinstance(one, NodeReport) and one.records == 0 for one in told.values()):
                    return
                await trio.sleep(LOOK_S)


@pytest.mark.timeout(300)
async def test_a_scene_that_was_ended_goes_from_all_disks_and_who_was_away_brings_nothing_back(tmp_path: Path) -> None:
    ports = free_ports(addresses(COUNT))
    async with local_cluster(COUNT, tmp_path, ports=ports, trust=True) as nodes, connect(nodes.profile) as cluster:
        estate = Estate(nodes, cluster)
        a, b, c, d = nodes.addresses
        await estate.done("scene", "create", "kitchen", "--participants", f"{a},{b},{c}")
        pot = tmp_path / "pot"
        pot.write_bytes(b"a pot" * 1_000)
        for number in range(8):
            await estate.done("data", "put", "files", f"{2 * number + 1:x}0", str(pot), "--scene", "kitchen")
        scene = await cluster.scenes.open("kitchen")
        planned = (await estate.done("scene", "rm", "kitchen", "--dry-run")).json
        assert (planned["ended"], planned["records"], planned["position"]) == (False, 8, None)
        (before,) = (await estate.done("scene", "log", "kitchen", "--last", "1")).json["entries"]
        earlier = f"{before['request']}@{before['position']}"
        # Who decides can be one fewer, and who only stores may be away.
        await nodes.kill(d)
        await nodes.kill(c)
        ended = (await estate.done("scene", "rm", "kitchen", "--yes")).json
        assert ended["ended"] and not ended["was_ended"] and ended["position"] > 1
        put, get = ("data", "put", "files", "10", str(pot)), ("data", "get", "files", "10")
        (header,) = [one for one in await cluster.scenes.headers() if one.genesis == scene.genesis]
        the_end = f"{header.request.hex()}@{ended['position']}"
        for request, position in ((the_end, ended["position"]), (earlier, before["position"])):
            assert (await estate.done("scene", "status", "kitchen", request)).json["position"] == position
        # Who is away holds it up that the others let go of it, and so refuse reads.
        await refused(estate, *put)
        await estate.restart(c, d)
        await refused(estate, *put)
        await estate.until_nothing_is_held()
        await refused(estate, *put)
        await refused(estate, *get)
        assert (await estate.done("scene", "status", "kitchen", the_end)).json["outcome"] == "committed"
        told = await estate.run("scene", "status", "kitchen", earlier)
        assert told.code == 3 and "nobody shows the log any more" in told.error, told.err
        told = await estate.run("scene", "mode", "kitchen")
        assert told.code == 4 and "was ended" in told.error, told.err
        assert (await estate.done("scene", "rm", "kitchen", "--yes")).json["was_ended"]
        assert (await estate.done("scene", "list")).json["scenes"] == []
        (kept,) = (await estate.done("scene", "list", "--ended")).json["scenes"]
        assert kept["name"] == "kitchen"
        assert "was ended" in (await estate.run("scene", "create", "kitchen")).refusal(1)
        for address in nodes.addresses:
            await nodes.stop(address)
        for address in nodes.addresses:
            check_disk(tmp_path / "data" / address, scene.id, scene.genesis)


async def refused(estate: Estate, *words: str) -> None:
    done = await estate.run(*words, "--scene", "kitchen")
    assert done.code == 4 and "was ended" in done.error, done.err


def check_disk(folder: Path, scene: SceneId, genesis: bytes) -> None:
    """Nothing of it but its header."""
    environment = LmdbDisk().open(folder, TABLES)
    try:
        with environment.read() as transaction:
            held = {
                table: len(list(transaction.scan(table, key, key + b"\xff" * 64)))
                for table, key in ((RECORDS, scene_key(scene)), (LOGS, genesis), (HEADERS, scene_key(scene)))
            }
    finally:
        environment.close()
    assert held == {RECORDS: 0, LOGS: 0, HEADERS: 1}, folder
