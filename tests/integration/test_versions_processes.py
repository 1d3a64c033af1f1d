"""If this fails, nodes of two adjacent versions, as processes that know no tables but their own, are not one cluster."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
import trio

from following_version import BOTH, Wave, next_version
from integration.living_clusters import Living, living_cluster
from integration.test_copies_processes import PATIENCE_S, whole
from scenefold.base.errors import Refused, Unreachable
from scenefold.base.location import LINE_LENGTH, Location
from scenefold.wire import NotSpoken
from scenefold.world import Priority, open_links, real_world
from scenefold.world.profile import ClusterProfile

TESTS = Path(__file__).resolve().parents[1]
NODES = 4
RECORDS = 80
WHOLE_S_MAX = 120.0

pytestmark = pytest.mark.slow


async def versions_spoken(living: Living) -> dict[str, bool]:
    """Of each node whether a program that takes both versions talks the next one with it."""
    profile = ClusterProfile.load(living.nodes.profile)
    world = real_world(profile.user_identity(), profile.authority_certificate(), ports=profile.ports, versions=BOTH)
    found = {}
    with next_version():
        async with open_links(world) as links:
            for address in living.nodes.addresses:
                with pytest.raises(Refused) as refused:
                    await links.request(address, Priority.HIGH, Wave("hello"), PATIENCE_S)
                found[address] = not isinstance(refused.value, NotSpoken)
    return found


async def reads(living: Living) -> bool:
    """All is right; or False: of a node that is away too few holders have answered in time, as happens on a busy machine."""
    try:
        await living.kept.check()
    except Unreachable:
        return False
    return True


@pytest.mark.timeout(1_200)
async def test_a_cluster_is_upgraded_a_node_at_a_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(TESTS))
    monkeypatch.setenv("LATER_NODES", "")
    async with living_cluster(tmp_path, NODES, options=("--remove-after", "13"), module="integration.later_node") as living:
        addresses, kept = living.nodes.addresses, living.kept
        kept.space = await (await living.cluster.scenes.open("kept")).create_space("copied", dimensions=1, copies=3)
        later: list[str] = []
        for turn, address in enumerate(addresses[1:3]):
            later.append(address)
            monkeypatch.setenv("LATER_NODES", ",".join(later))
            await living.nodes.stop(address)
            living.nodes.start(address)
            await living.nodes.wait([address])
            await kept.put([Location.from_number(LINE_LENGTH * (3 * index + 1 + turn) // (3 * RECORDS)) for index in range(RECORDS)], 3_000)
        assert await versions_spoken(living) == {address: address in later for address in addresses}
        await whole(living, NODES, WHOLE_S_MAX)
        # One of the next version; nodes of both fill it again.
        await living.nodes.kill(later[-1])
        shutil.rmtree(living.nodes.folder / "data" / later[-1])
        with trio.fail_after(PATIENCE_S):
            while not await reads(living):  # noqa: ASYNC110 - nobody tells when holders have time
                await trio.sleep(1.0)
        living.nodes.start(later[-1])
        await whole(living, NODES, WHOLE_S_MAX)
        await kept.check()
