"""If this fails, processes that decide a cluster's log together stop when one of them dies, or two of three decide that cannot be a majority."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest
import trio

from integration.living_clusters import Kept
from integration.scenectl_process import Done, scenectl
from loopback import addresses, free_ports
from scenefold.base.ids import SpaceId
from scenefold.client import Cluster, connect
from scenefold.node.local import LocalCluster, local_cluster

COUNT, VOTERS = 5, 3
LEASES_LAST_S = 15.0
"""Longer than an owner may go on without a word of the voters."""
PATIENCE_S, LOOK_S = 60.0, 0.5

pytestmark = pytest.mark.slow


class Senate:
    """Processes, records that a client had acknowledged, and scenectl as an administrator runs it."""

    def __init__(self, nodes: LocalCluster, cluster: Cluster, kept: Kept) -> None:
        self.nodes, self.cluster, self.kept = nodes, cluster, kept

    async def run(self, *arguments: str) -> Done:
        return await trio.to_thread.run_sync(lambda: scenectl(*arguments, "--json", profile=self.nodes.profile))

    async def voters(self, *order: str) -> list[str]:
        done = await self.run("cluster", *(order or ("voters",)))
        assert done.code == 0, done.err
        assert done.json["preparing"] == []
        found: list[str] = done.json["voters"]
        return found

    async def decides(self, *order: str) -> None:
        """The cluster's log takes one entry more, though perhaps not at the first time of asking: who died leads until it is missed."""
        with trio.fail_after(PATIENCE_S):
            while (done := await self.run("cluster", *order)).code != 0:
                assert done.code in (3, 4), done.err
                await trio.sleep(LOOK_S)

    async def restart(self, *killed: str) -> None:
        for address in killed:
            self.nodes.start(address)
        await self.nodes.wait(killed)

    async def write_on(self, seconds: float) -> int:
        """Where owners live; how often."""
        until, rounds = trio.current_time() + seconds, 0
        while trio.current_time() < until:
            rounds += 1
            # The first node owns the first fifth of the line, and is not there.
            await self.kept.put_evenly(20 + rounds, 300, last_part=0.75)
            await trio.sleep(LOOK_S)
        return rounds


@pytest.mark.timeout(300)
async def test_a_cluster_goes_on_without_one_of_three_voters_and_not_without_two(tmp_path: Path) -> None:
    ports = free_ports(addresses(COUNT))
    async with local_cluster(COUNT, tmp_path, ports=ports) as nodes, connect(nodes.profile) as cluster:
        scene = await cluster.scenes.create("kept", copies=1)
        senate = Senate(nodes, cluster, Kept(scene.space(SpaceId(10))))
        a, b, c, d, e = nodes.addresses
        assert await senate.voters() == [a]
        refused = await senate.run("cluster", "add-voter", b)
        assert "trust" in refused.refusal(1)
        await senate.decides("trust", "--all")
        for address in (b, c):
            # Done once those who decide have what they need to lose one of them.
            await senate.voters("add-voter", address)
        assert await senate.voters() == [a, b, c]
        await senate.kept.put_evenly(40, 300)
        await one_of_three_dies(senate, a, d)
        await two_of_three_die(senate, b, c, e)


async def one_of_three_dies(senate: Senate, dies: str, changed: str) -> None:
    """The one that decided alone before: the two others decide, and lend owners their leases."""
    await senate.nodes.kill(dies)
    await senate.decides("trust", changed, "--withdraw")
    assert await senate.write_on(LEASES_LAST_S) > 1
    await senate.restart(dies)
    await senate.kept.check()
    await senate.decides("trust", changed)
    assert len(await senate.voters()) == VOTERS


async def two_of_three_die(senate: Senate, *rest: str) -> None:
    """Nothing is decided any more, and all that was acknowledged is there when they are back."""
    *dead, changed = rest
    for address in dead:
        await senate.nodes.kill(address)
    refused = await senate.run("cluster", "trust", changed, "--withdraw")
    assert "no majority: of 3 voters too few answer" in refused.refusal(4)
    trusted = await trusted_of(senate, changed)
    await senate.restart(*dead)
    await senate.decides("trust", changed, "--withdraw")
    assert trusted, "it was refused, so nothing had changed"
    assert not await trusted_of(senate, changed)
    await senate.kept.check()


async def trusted_of(senate: Senate, address: str) -> bool:
    done = await senate.run("cluster", "status")
    assert done.code in (0, 5), done.err
    nodes: Sequence[dict[str, object]] = done.json["nodes"]
    (found,) = (node for node in nodes if node["address"] == address)
    return bool(found["trusted"])
