"""How long so many participants take to decide a change of a scene, in virtual time (specs/17-simulation.md, Decisions).

Each packet takes as long as a link takes, and nothing else takes any time: what is left is how often one waits for another. So this counts
the hops of a decision, not the work that it is.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterator, Sequence
from contextlib import AsyncExitStack
from typing import Any

import trio

from scenefold.client.scene import Scene
from scenefold.simulation.clients import MemoryKeyring, open_client
from scenefold.simulation.cluster import Cluster, Habits, key_of
from scenefold.simulation.disks import incarnation_of
from scenefold.simulation.logs import quiet_logs
from scenefold.simulation.speed import quick_packets, remembered_signatures
from scenefold.wire import Member, ParticipantEntry, TranslateSpace
from scenefold.world.sim import Delay, SimNet, Trace, Weather, run_simulated

LINK_S = 0.001
START_S_MAX = 120.0
SETTLE_S = 15.0
BETWEEN_S = 0.05
"""Between two changes, so that those who were told last know of the one before."""
LOOK_S = 0.05
VIRTUAL_S_MAX = 5_000.0
WALL_S_MAX = 3_600.0
_SPACE = "bench"


def measure(participants: int, commits: int, *, clients: int = 1, seed: int = 0, link_s: float = LINK_S) -> dict[str, Any]:
    """Changes of one scene, each client asking for one after the other."""
    with quiet_logs(), remembered_signatures(), quick_packets():
        return run_simulated(
            seed, _measured, participants, commits, clients, seed, link_s, virtual_s_max=VIRTUAL_S_MAX, wall_s_max=WALL_S_MAX
        )


async def _measured(participants: int, commits: int, clients: int, seed: int, link_s: float) -> dict[str, Any]:
    weather = Weather(Delay(link_s, 0.0, link_s), splitting=0.0, bytes_per_s=1e15)
    net = SimNet(seed, weather=weather, trace=Trace(keep=0), costs={})
    async with trio.open_nursery() as nursery:
        cluster = Cluster(net, participants, 0, nursery, Habits(remove_after_s=None))
        for slot in range(participants):
            cluster.start(slot)
        await _until(lambda: len(cluster.running) == participants and all(node.has_lease() for node in cluster.running.values()))
        await trio.sleep(SETTLE_S)
        world = net.world("user:bench")
        keyring, writer = MemoryKeyring(), key_of(seed, "the writer")
        async with open_client("bench", world, cluster.facts, keyring, writer, cluster.watch.recorder) as client:
            scene = await client.scenes.create("bench", copies=1, participants=_entries(cluster))
            await scene.create_space(_SPACE, copies=1)
            async with AsyncExitStack() as others:
                scenes = [scene]
                for number in range(1, clients):
                    name = f"bench {number}"
                    opening = open_client(name, net.world(f"user:{name}"), cluster.facts, keyring, writer, cluster.watch.recorder)
                    scenes.append(await (await others.enter_async_context(opening)).scenes.open("bench"))
                row = await _decided(cluster, scenes, commits)
        violations = [violation.what for violation in cluster.watch.violations]
        nursery.cancel_scope.cancel()
    return {"participants": participants, "link_ms": 1000 * link_s, "commits": commits, **row, "violations": violations}


async def _decided(cluster: Cluster, scenes: Sequence[Scene], commits: int) -> dict[str, Any]:
    waits_s, left = list[float](), iter(range(commits))

    async def ask(scene: Scene, left: Iterator[int]) -> None:
        for _ in left:
            begun = cluster.net.now
            await scene.access.change_log(lambda log: TranslateSpace(log.named(_SPACE).id, (0.5, 0.0, 0.0)))
            waits_s.append(cluster.net.now - begun)
            await trio.sleep(BETWEEN_S)

    packets = _packets(cluster)
    async with trio.open_nursery() as nursery:
        for scene in scenes:
            nursery.start_soon(ask, scene, left)
    cuts = statistics.quantiles(waits_s, n=100, method="inclusive") if commits > 1 else waits_s * 99
    return {
        # While all of them ask: the pauses between are not counted.
        "commits_per_s": len(scenes) / statistics.fmean(waits_s),
        "p50_ms": 1000 * cuts[49],
        "p99_ms": 1000 * cuts[98],
        "packets_per_commit": (_packets(cluster) - packets) / commits,
    }


def _entries(cluster: Cluster) -> tuple[ParticipantEntry, ...]:
    return tuple(
        ParticipantEntry(Member(node.node_id, incarnation_of(node.disk) or b""), node.secrets.signing.public.raw)
        for node in cluster.running.values()
    )


def _packets(cluster: Cluster) -> int:
    return sum(node.context.logs.packets_sent for node in cluster.running.values() if node.context is not None)


async def _until(holds: Callable[[], bool]) -> None:
    with trio.fail_after(START_S_MAX):
        while not holds():  # noqa: ASYNC110 - what it waits for is in several nodes, which tell nobody
            await trio.sleep(LOOK_S)
