"""If this fails, readers wait for a slow disk, or for a dead node, though others have what they want."""

from __future__ import annotations

import statistics
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
import trio

from integration.living_clusters import living_cluster
from integration.test_copies_processes import whole
from scenectl.bench_weather import slow_disk
from scenefold.base.location import LINE_LENGTH, Location
from scenefold.client import Space
from scenefold.wire import Packet

NODES = 4
COUNT = 64
SLOW_S = 0.5
"""As bench_weather.slow_disk is patched to be."""
SOON_S = 15.0


def counted(space: Space) -> Counter[tuple[str, str]]:
    """What is asked of whom from now on."""
    links: Any = space._access.calls._links
    seen, request = Counter[tuple[str, str]](), links.request

    async def watched(address: str, priority: Any, packet: Packet, timeout_s: float) -> Packet:
        seen[address, type(packet).__name__] += 1
        answer: Packet = await request(address, priority, packet, timeout_s)
        return answer

    links.request = watched
    return seen


@pytest.mark.slow
@pytest.mark.timeout(300)
async def test_much_of_one_owner_comes_from_all_and_neither_a_slow_disk_nor_a_dead_node_is_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("scenectl.bench_weather.SLOW_DISK_S", SLOW_S)
    async with living_cluster(tmp_path, NODES, module="scenectl.slow_node") as living:
        scene = await living.cluster.scenes.open("kept")
        space = await scene.create_space("copied", dimensions=1, copies=3)
        # All of it lies with the last node, which neither votes nor decides.
        victim = living.nodes.addresses[-1]
        places = [Location.from_number(LINE_LENGTH - (index + 1) * (LINE_LENGTH // 1000)) for index in range(COUNT)]
        items = [(place, index.to_bytes(2, "big") * 10_000) for index, place in enumerate(places)]
        await space.put_many(items)
        await whole(living, NODES, 60.0)
        assert {space._access.calls.table.owner_of(place).address for place in places} == {victim}

        async def check(only: list[Location] | None = None) -> float:
            """How long it takes to read these, or all."""
            begun, wanted = trio.current_time(), only or places
            assert await space.get_many(wanted) == [dict(items)[place] for place in wanted]
            return trio.current_time() - begun

        asked = counted(space)
        await check()
        helpers = {address for address, kind in asked if kind == "GetCopies"}
        assert len(helpers - {victim}) >= 2, "those who hold copies"
        for place in places:
            await check([place])
        with slow_disk(living.nodes, victim):
            await check()
            waits_s = [await check([place]) for place in places]
        assert statistics.median(waits_s[COUNT // 2 :]) < SLOW_S, "with the owner it takes as long as that"
        await living.nodes.kill(victim)
        with trio.fail_after(SOON_S):
            await check()
            for place in places:
                await check([place])
