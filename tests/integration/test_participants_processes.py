"""If this fails, nodes that decide a scene together do not do so as processes: one that is killed takes the scene with it, or never comes back to it."""

from __future__ import annotations

from pathlib import Path

import pytest
import trio

from integration.scenectl_process import Done, scenectl
from loopback import addresses, free_ports
from scenefold.client import Cluster, connect
from scenefold.node.local import LocalCluster, local_cluster
from scenefold.wire import RequestSceneLog, RespondSceneLog, Want
from scenefold.world import Priority

COUNT = 5
SOON_S = 20.0
"""Measured with all else that runs beside tests; a quiet machine takes one or two."""
PATIENCE_S, LOOK_S = 60.0, 0.2


class Studio:
    """Processes, a client that asks one node at a time, and scenectl."""

    def __init__(self, nodes: LocalCluster, cluster: Cluster) -> None:
        self.nodes, self.cluster = nodes, cluster

    async def run(self, *arguments: str) -> Done:
        """`scenectl ... --json`, beside all that goes on here."""
        return await trio.to_thread.run_sync(lambda: scenectl(*arguments, "--json", profile=self.nodes.profile))

    async def done(self, *arguments: str) -> Done:
        done = await self.run(*arguments)
        assert done.code == 0, done.err
        return done

    async def move(self) -> float:
        """One change; how far the hall is then."""
        begun = trio.current_time()
        done = await self.done("space", "translate", "hall", "--by", "1,0,0", "--scene", "kitchen")
        assert trio.current_time() - begun < SOON_S
        offset: float = done.json["offset"][0]
        return offset

    async def position(self, address: str) -> int:
        """How far one node is by what it has itself: the log that it keeps."""
        scene = await self.cluster.scenes.open("kitchen")
        packet = RequestSceneLog(scene.id, scene.genesis, 0, 1, Want.LOG)
        answer = (await self.cluster.calls.ask(address, packet, RespondSceneLog, priority=Priority.HIGH)).answer
        assert answer is not None and answer.private is not None
        return answer.position

    async def comes_to(self, address: str, position: int) -> None:
        with trio.fail_after(PATIENCE_S):
            while True:
                if await self.position(address) == position:
                    return
                await trio.sleep(LOOK_S)


@pytest.mark.timeout(300)
async def test_a_scene_goes_on_when_one_of_those_who_decide_it_is_killed_and_has_it_back(tmp_path: Path) -> None:
    ports = free_ports(addresses(COUNT))
    async with local_cluster(COUNT, tmp_path, ports=ports) as nodes, connect(nodes.profile) as cluster:
        studio = Studio(nodes, cluster)
        a, b, c, d, _ = nodes.addresses
        await nobody_decides_who_is_not_trusted(studio, b)
        await studio.done("cluster", "trust", "--all")
        made = await studio.run("scene", "create", "kitchen", "--participants", f"{a},{b},{c}")
        assert made.code == 0 and "warning" not in made.err, made.err
        await studio.done("scene", "create", "default")
        assert (await studio.done("scene", "participants", "default")).json["decided_by"] == list(nodes.addresses)
        await studio.done("space", "create", "hall", "--scene", "kitchen")
        told = (await studio.done("scene", "participants", "kitchen")).json
        assert (told["decided_by"], told["majority"], told["by_origin_alone"]) == ([a, b, c], 2, False)

        await nodes.kill(b)
        assert await studio.move() == 1
        nodes.start(b)
        await nodes.wait([b])
        await studio.comes_to(b, 3)
        # The one whose scenes these all are, and that is asked first.
        await nodes.kill(a)
        assert await studio.move() == 2
        await nodes.kill(c)
        refused = await studio.run("space", "translate", "hall", "--by", "1,0,0", "--scene", "kitchen")
        assert refused.code in (3, 4), refused.err
        assert "2 of 3 must agree" in refused.err or refused.code == 3, refused.err
        nodes.start(a)
        await nodes.wait([a])
        nodes.start(c)
        await nodes.wait([c])
        if refused.code == 3:
            # Nobody knew; now somebody does.
            request = refused.err.partition("scene status kitchen ")[2].partition("`")[0]
            assert (await studio.run("scene", "status", "kitchen", request)).code in (0, 3, 4)
        moved = await studio.move()
        assert moved == 3 or (moved == 4 and refused.code == 3)
        await who_decides_changes(studio, d, a)
        await the_log_tells_it(studio, a)


async def nobody_decides_who_is_not_trusted(studio: Studio, address: str) -> None:
    refused = await studio.run("scene", "create", "kitchen", "--participants", "3")
    assert "3 participants are asked for" in refused.refusal(1) and f"cluster trust {address}" in refused.error
    refused = await studio.run("scene", "create", "kitchen", "--participants", address)
    assert "not trusted" in refused.refusal(1) and address in refused.error


async def who_decides_changes(studio: Studio, comes: str, goes: str) -> None:
    added = await studio.done("scene", "add-participant", "kitchen", comes)
    assert len(added.json["decided_by"]) == 4 and "3 of the 4 must agree" in added.err
    removed = await studio.done("scene", "remove-participant", "kitchen", goes)
    assert comes in removed.json["decided_by"] and goes not in removed.json["decided_by"]
    assert (await studio.run("scene", "remove-participant", "kitchen", goes)).refusal(1)
    await studio.comes_to(comes, removed.json["position"])


async def the_log_tells_it(studio: Studio, first: str) -> None:
    log = (await studio.done("scene", "log", "kitchen")).json
    assert [entry["position"] for entry in log["entries"]] == list(range(1, log["position"] + 1))
    assert log["entries"][0]["by_origin_alone"] and log["entries"][0]["decided_by"] == [first]
    assert [entry["entry"]["kind"] for entry in log["entries"][-2:]] == ["AddParticipant", "RemoveParticipant"]
    vouched = [entry for entry in log["entries"] if entry["accepted_by"] is not None]
    assert vouched and all(len(entry["accepted_by"]) * 2 > len(entry["decided_by"]) for entry in vouched)
    assert vouched[-1]["seen"] is not None
