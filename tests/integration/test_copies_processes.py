"""If this fails, what was acknowledged is gone, or not whole again, after two nodes of a rack were killed and their disks wiped.

SCENEFOLD_FULL_SIZE=1 runs it as docs/benchmarks.md quotes it: seven nodes in three racks, 2 GiB in 40,000 records (with -s it prints its figures).
"""

from __future__ import annotations

import json
import math
import os
import shutil
from dataclasses import dataclass
from pathlib import Path

import pytest
import trio

from integration.living_clusters import Kept, Living, living_cluster
from integration.whole_copies import whole
from scenefold.base.location import LINE_LENGTH, Location
from scenefold.base.prefixes import AddressPrefix, address_prefix
from scenefold.client import connect
from scenefold.client.reports import NodeReport

COPIES = 3
BATCH = 64
PATIENCE_S = 60.0
LOOK_S = 0.5
MOVED = ("copied bytes", "fetched bytes", "recovered bytes", "handed bytes", "brought home bytes")
"""What nodes move by themselves, each byte counted once: to holders, from holders that had something newer, to who adopts, in handovers, and strays."""


@dataclass(frozen=True)
class Size:
    """`racks`: how many nodes stand in each. That of the voter is the first, and the second one is lost."""

    racks: tuple[int, ...]
    records: int
    payloads: tuple[int, ...]
    """Bytes, in turns."""
    whole_s_max: float
    still_s: float
    """After everything is whole: for as long nothing may have been moved before it is counted. A placement that has lasted is followed after ten."""
    moved_max: float
    """So many times what was lost may be moved."""
    options: tuple[str, ...] = ()


# No bound for the small size would be sound: what was lost are a few MiB, less than a single piece that balance or a newcomer may move, and
# the dead are removed after seconds, so that copies are made elsewhere, and once more where they belong when their nodes are back. How often
# depends on when each of them is heard, and not on how much was lost.
SMALL = Size((1, 2, 2), 300, (300, 4_000, 60_000), 120.0, 0.0, math.inf, ("--remove-after", "13"))
FULL = Size((2, 2, 3), 40_000, (1_000, 61_440, 60_000, 61_440, 61_440, 61_440, 61_440, 61_440), 1_800.0, 15.0, 1.25)
"""With two minutes until the dead are removed, as people have it: who is back before that gets its own copies, and none are made elsewhere.

The goal is 1.15; 0.98 and 1.04 were measured (docs/benchmarks.md). The tenth above the goal is for a machine that does other things meanwhile:
then a bound may move while copies are made, and what lies beside it is copied anew.
"""

pytestmark = pytest.mark.slow


def racks_of(living: Living, size: Size) -> list[list[str]]:
    addresses = iter(living.nodes.addresses)
    return [[next(addresses) for _ in range(count)] for count in size.racks]


async def put_in_racks(living: Living, racks: list[list[str]]) -> None:
    """Each node wants no copies of its own in its rack."""
    for rack in racks:
        for address in rack:
            others: list[AddressPrefix] = [address_prefix(other) for other in rack if other != address]
            await living.cluster.blacklist(address, add=others)


async def fill(kept: Kept, size: Size) -> None:
    """Records of mixed sizes, evenly over the line."""
    places = [Location.from_number(LINE_LENGTH * (2 * index + 1) // (2 * size.records)) for index in range(size.records)]
    for start in range(0, size.records, BATCH):
        await kept.put(places[start : start + BATCH], size.payloads[start // BATCH % len(size.payloads)])


async def still(living: Living, nodes: int, size: Size, found: dict[str, NodeReport]) -> dict[str, NodeReport]:
    """Reports once nothing has been moved for a while."""
    with trio.fail_after(size.whole_s_max):
        since = trio.current_time()
        while trio.current_time() - since < size.still_s:
            await trio.sleep(LOOK_S)
            newer = await whole(living, nodes, size.whole_s_max)
            if any(told(newer[address], name) != told(found[address], name) for address in found for name in MOVED):
                since = trio.current_time()
            found = newer
    return found


@pytest.mark.timeout(3_600)
async def test_a_rack_is_killed_and_wiped_during_writes_and_all_is_there_and_whole_again(tmp_path: Path) -> None:
    size = FULL if os.environ.get("SCENEFOLD_FULL_SIZE") == "1" else SMALL
    count = sum(size.racks)
    async with living_cluster(tmp_path, count, options=size.options) as living:
        racks = racks_of(living, size)
        await put_in_racks(living, racks)
        scene = await living.cluster.scenes.open("kept")
        kept = living.kept
        kept.space = await scene.create_space("copied", dimensions=1, copies=COPIES)
        await fill(kept, size)
        before = await whole(living, count, size.whole_s_max, at_rest=True)
        under_copied = sum(report.bytes for address, report in before.items() if address in racks[1])
        async with trio.open_nursery() as nursery:
            nursery.start_soon(kept.go_on_writing)
            killed_at = trio.current_time()
            for address in racks[1]:
                await living.nodes.kill(address)
            for address in racks[1]:
                shutil.rmtree(living.nodes.folder / "data" / address)
            with trio.fail_after(PATIENCE_S):
                # Of each record two copies live, or one and the owner: none has to wait for the dead.
                await kept.check()
            begun = trio.current_time()
            for address in racks[1]:
                living.nodes.start(address)
            await whole(living, count, size.whole_s_max, while_writing=True)
            nursery.cancel_scope.cancel()
        after = await whole(living, count, size.whole_s_max)
        seconds = trio.current_time() - begun
        after = await still(living, count, size, after)
        changed = [address for address in before if before[address].incarnation != after[address].incarnation]
        assert sorted(changed) == racks[1], "who comes back with an empty disk is somebody else"
        await kept.check()
        async with connect(living.nodes.profile) as other:
            space = (await other.scenes.open("kept")).space(kept.space.id)
            await Kept.check(replaced(kept, space))
        # Those that were wiped began to count anew.
        moved = {
            name: sum(told(after[address], name) - (0 if address in racks[1] else told(report, name)) for address, report in before.items())
            for name in MOVED
        }
        print(
            json.dumps(
                {
                    "nodes": count,
                    "records": len(kept.records),
                    "seconds_away": round(begun - killed_at, 1),
                    "seconds_to_health": round(seconds, 1),
                    "bytes_lost": under_copied,
                    "bytes_moved": sum(moved.values()),
                    "of_bytes_lost": round(sum(moved.values()) / under_copied, 2),
                    **{name.replace(" ", "_"): count for name, count in moved.items()},
                }
            )
        )
        assert sum(moved.values()) <= size.moved_max * under_copied


def told(report: NodeReport, name: str) -> int:
    """What a node has counted under that name since it was started."""
    found: int = report.document["events"].get(name, 0)
    return found


def replaced(kept: Kept, space: object) -> Kept:
    """The same records, as another client reads them."""
    other = Kept(space)  # type: ignore[arg-type]
    other.records = kept.records
    return other
