"""If this fails, nodes outlive who started them, lose what they acknowledged when killed, or die without saying why."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import trio

from integration.clusters import PATIENCE_S, links_of_user
from integration.made_scenes import scene_in
from integration.test_cluster_data import proposal_of
from loopback import addresses, free_ports
from scenefold.base.errors import LocalFault
from scenefold.base.ids import node_id_of
from scenefold.base.location import Location
from scenefold.node.local import LocalCluster, local_cluster
from scenefold.store import LmdbDisk
from scenefold.store.layout import HOLDING, IDENTITY, NOTES, TABLES
from scenefold.wire import (
    AcceptSceneProposal,
    DrainNode,
    GetMany,
    GetManyReply,
    PutItem,
    PutMany,
    PutManyReply,
    RecordKey,
    RequestTable,
)
from scenefold.world import Links, Priority
from scenefold.world.profile import ClusterProfile
from unit.peer.scenes_made import SPACE, offered, sealed

PARENT = """
import sys, trio
from pathlib import Path
from scenefold.node.local import local_cluster
from scenefold.world import Ports

async def main():
    async with local_cluster(2, Path(sys.argv[1]), ports=Ports(int(sys.argv[2]), int(sys.argv[3]))) as cluster:
        print(*(cluster.pid(address) for address in cluster.addresses), flush=True)
        await trio.sleep_forever()

trio.run(main)
"""


def node_command(profile: ClusterProfile, address: str, data: Path, *options: str) -> list[str]:
    arguments = ["--profile", str(profile.folder), "--address", address, "--data", str(data), *options]
    return [sys.executable, "-m", "scenefold.node", *arguments]


async def run_to_end(command: list[str]) -> tuple[int, dict[str, Any], str]:
    """Exit code, last event and log of a node that should not run for long."""
    with trio.fail_after(60):
        done = await trio.run_process(command, capture_stdout=True, capture_stderr=True, check=False)
    events = [json.loads(line) for line in done.stdout.splitlines()]
    return done.returncode, events[-1] if events else {}, done.stderr.decode()


async def ask(links: Links, address: str, packet: Any) -> Any:
    return await links.request(address, Priority.LOW, packet, PATIENCE_S)


def items(cluster: LocalCluster) -> list[PutItem]:
    """Records all over the line."""
    scene = scene_in(cluster.known)
    places = (Location.from_number((2 * index + 1) << 156) for index in range(8))
    return [offered(sealed(scene, location=place, payload=bytes(place))) for place in places]


async def put_everywhere(cluster: LocalCluster, links: Links) -> None:
    assert isinstance(await ask(links, cluster.addresses[0], proposal_of(scene_in(cluster.known))), AcceptSceneProposal)
    left = items(cluster)
    for address in cluster.addresses:
        reply = await ask(links, address, PutMany(items=tuple(left)))
        assert isinstance(reply, PutManyReply)
        left = [item for item, outcome in zip(left, reply.outcomes, strict=True) if outcome.reason != 0]
    assert left == []


async def all_readable(cluster: LocalCluster, links: Links) -> None:
    keys = tuple(RecordKey(SPACE, item.location) for item in items(cluster))
    for address in cluster.addresses:
        reply = await ask(links, address, GetMany(scene=scene_in(cluster.known).scene, position=1, keys=keys))
        assert isinstance(reply, GetManyReply)
        assert [record.header if record else None for record in reply.records] == [item.header for item in items(cluster)]


async def test_what_was_acknowledged_survives_a_kill_and_a_new_start(tmp_path: Path) -> None:
    ports = free_ports()
    async with local_cluster(3, tmp_path, ports=ports) as cluster, links_of_user(cluster.known) as links:
        await put_everywhere(cluster, links)
        victim = cluster.addresses[1]
        await cluster.kill(victim)
        cluster.start(victim)
        await cluster.wait([victim])
        await all_readable(cluster, links)
        await cluster.stop(victim)
        cluster.start(victim)
        await cluster.wait()
        await all_readable(cluster, links)
        pids = [cluster.pid(address) for address in cluster.addresses]
    assert not any(pid and is_running(pid) for pid in pids)
    async with local_cluster(3, tmp_path, ports=ports) as cluster, links_of_user(cluster.known) as links:
        await all_readable(cluster, links)
    logs = "".join(cluster.log(address).read_text() for address in cluster.addresses)
    assert "Traceback" not in logs and "boot 4" in logs


async def test_a_spare_joins_and_leaves_in_order(tmp_path: Path) -> None:
    """Its process ends by itself once it has given everything back, and nobody takes that for an accident."""
    async with local_cluster(2, tmp_path, spares=1, ports=free_ports()) as cluster, links_of_user(cluster.known) as links:
        await put_everywhere(cluster, links)
        (spare,) = cluster.spares
        cluster.start(spare)
        await cluster.wait([spare])
        table = await ask(links, cluster.addresses[1], RequestTable())
        assert [status.node for status in table.statuses].count(node_id_of(spare)) == 1
        await all_readable(cluster, links)
        await ask(links, spare, DrainNode(check_only=False, cancel=False))
        with trio.fail_after(60):
            await cluster.ended(spare)
        await all_readable(cluster, links)
        table = await ask(links, cluster.addresses[1], RequestTable())
        assert [status.node for status in table.statuses] == list(map(node_id_of, cluster.addresses))
    assert "Traceback" not in cluster.log(spare).read_text()


async def test_a_node_that_dies_ends_the_block_with_its_error(tmp_path: Path) -> None:
    async def lose_a_node() -> None:
        async with local_cluster(1, tmp_path, ports=free_ports()) as cluster:
            pid = cluster.pid("127.0.0.2")
            assert pid is not None
            os.kill(pid, signal.SIGKILL)
            with trio.fail_after(PATIENCE_S):
                await trio.sleep_forever()

    with pytest.raises(LocalFault, match=r"node 127\.0\.0\.2 ended unexpectedly \(SIGKILL\)"):
        await lose_a_node()


async def test_a_second_cluster_on_the_same_ports_says_so_and_leaves_nothing(tmp_path: Path) -> None:
    ports = free_ports()
    async with local_cluster(1, tmp_path / "one", ports=ports):
        with pytest.raises(LocalFault, match=r"node 127\.0\.0\.2 cannot run: .* in use"):
            async with local_cluster(2, tmp_path / "two", ports=ports):
                raise AssertionError("it must not start")


async def test_a_folder_of_another_cluster_is_refused(tmp_path: Path) -> None:
    ClusterProfile.create(tmp_path / "profile", "three", addresses(3), ports=free_ports())
    with pytest.raises(LocalFault, match="a cluster of 3 nodes"):
        async with local_cluster(2, tmp_path):
            raise AssertionError("it must not start")


async def test_nodes_end_when_their_parent_is_killed(tmp_path: Path) -> None:
    ports = free_ports()
    command = [sys.executable, "-c", PARENT, str(tmp_path), str(ports.low), str(ports.high)]
    process = await trio.lowlevel.open_process(command, stdout=subprocess.PIPE)
    assert process.stdout is not None
    with trio.fail_after(60):
        pids = [int(text) for text in (await process.stdout.receive_some()).split()]
    handles = [os.pidfd_open(pid) for pid in pids]
    process.kill()
    await process.wait()
    try:
        with trio.fail_after(PATIENCE_S):
            for handle in handles:
                await trio.lowlevel.wait_readable(handle)
    finally:
        for handle in handles:
            os.close(handle)
        await process.stdout.aclose()


def is_running(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.fixture
def profile(tmp_path: Path) -> ClusterProfile:
    return ClusterProfile.create(tmp_path / "profile", "trial", addresses(2), ports=free_ports())


async def test_a_silent_seed_is_an_error_in_the_end(tmp_path: Path, profile: ClusterProfile) -> None:
    command = node_command(profile, "127.0.0.2", tmp_path / "data", "--seed", "127.0.0.9", "--seed-wait", "0.6")
    code, event, log = await run_to_end(command)
    assert code == 3 and event["event"] == "failed" and event["where"] == "127.0.0.9"
    assert log.count("no seed answers yet (127.0.0.9)") == 1


async def test_another_nodes_data_folder_is_refused(tmp_path: Path, profile: ClusterProfile) -> None:
    first = node_command(profile, "127.0.0.2", tmp_path / "data", "--seed", "127.0.0.9", "--seed-wait", "0.2")
    await run_to_end(first)
    code, event, log = await run_to_end(node_command(profile, "127.0.0.3", tmp_path / "data"))
    assert code == 1 and "belongs to node 127.0.0.2" in event["what"]
    assert "Traceback" not in log


@pytest.mark.parametrize(
    ("table", "key"), [(IDENTITY, b"incarnation"), (HOLDING, b"note"), (NOTES, b"cluster-log/00000000"), (NOTES, b"cluster-log/lives")]
)
async def test_a_damaged_data_folder_stops_the_node_with_one_error(tmp_path: Path, profile: ClusterProfile, table: str, key: bytes) -> None:
    data = tmp_path / "data"
    command = node_command(profile, "127.0.0.2", data, "--seed", "127.0.0.9", "--seed-wait", "0.2")
    await run_to_end(command)
    environment = LmdbDisk().open(data, TABLES)
    environment.update(lambda transaction: transaction.put(table, key, b"what nobody wrote"))
    environment.close()
    code, event, log = await run_to_end(command)
    assert (code, event["event"], event["where"]) == (1, "failed", str(data)), log
    assert event["what"] == f"{key.decode()!r} in the table {table!r} of the store has changed on the disk"
    assert "wipe the folder" in event["remedy"]
    assert "Traceback" not in log


@pytest.mark.parametrize(
    "arguments, code, what",
    [
        (["--address", "127.0.0.7"], 1, "no node of this cluster"),
        (["--address", "kitchen"], 2, "no IPv4 address"),
        (["--address", "127.0.0.2", "--threads", "0"], 2, "0 render threads"),
        (["--address", "127.0.0.2", "--seed", "x"], 2, "no IPv4 address"),
        (["--address", "127.0.0.2", "--profile", "/nowhere"], 1, "no cluster profile"),
    ],
)
async def test_bad_settings_are_one_clear_error(
    tmp_path: Path, profile: ClusterProfile, arguments: list[str], code: int, what: str
) -> None:
    command = node_command(profile, "127.0.0.2", tmp_path / "data", *arguments)
    ended, event, log = await run_to_end(command)
    assert ended == code and what in event["what"]
    assert "Traceback" not in log and len(log.strip().splitlines()) == 1
