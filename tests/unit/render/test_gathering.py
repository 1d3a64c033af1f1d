"""If this fails, a large film that comes over a slow link is given up though every part of it comes in time."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest
import trio

from scenefold.base.ids import NodeId
from scenefold.render.pool.gathering import MERGE_S_MIN, PART_S_MAX, Gathering, merge_s_max
from scenefold.wire import FilmPart, JobAnswer, MergeFilm, Packet

NODES = tuple(NodeId(0x7F000002 + index) for index in range(5))


class Host:
    """A node, and what it asks of others."""

    def __init__(self, place: int) -> None:
        self.node_id = NODES[place]
        self.asked: list[tuple[NodeId, Packet, float]] = []
        self.world = SimpleNamespace(workers=SimpleNamespace(run=self.run))

    async def run(self, _lane: str, function: Any, *arguments: Any) -> Any:
        return function(*arguments)

    async def ask(self, node: NodeId, packet: Packet, timeout_s: float) -> JobAnswer:
        self.asked.append((node, packet, timeout_s))
        return JobAnswer(7, 0, "")


def films(parts: int) -> Any:
    def nothing(*_: object) -> None:
        return None

    return SimpleNamespace(
        begin=nothing, part=lambda _index: b"", part_count=parts, take_gathered=nothing, check_came=nothing, check_samples=nothing
    )


def test_at_least_ten_minutes_and_two_for_each_part_of_each_film() -> None:
    assert merge_s_max(1, 1) == MERGE_S_MIN == 600.0
    assert merge_s_max(20, 4) == 20 * 4 * PART_S_MAX


@pytest.mark.parametrize(("me", "behind"), [(0, {1: 4}), (2, {1: 2, 3: 2}), (4, {3: 4})])
async def test_the_organiser_waits_for_all_films_behind_each_neighbour(me: int, behind: dict[int, int]) -> None:
    host = Host(me)
    gathering = Gathering(cast(Any, host), cast(Any, SimpleNamespace(id=7, plan=SimpleNamespace(size=int))), films(20), trio.Lock())
    await gathering.gather(1, cast(Any, SimpleNamespace(nodes=NODES)), ())
    assert {NODES.index(node): wait_s for node, _, wait_s in host.asked} == {
        place: merge_s_max(20, films) for place, films in behind.items()
    }
    assert all(isinstance(packet, MergeFilm) for _, packet, _ in host.asked)


async def test_who_hands_on_waits_for_those_behind_it() -> None:
    host = Host(3)
    gathering = Gathering(cast(Any, host), cast(Any, SimpleNamespace(id=7, plan=SimpleNamespace(size=int))), films(2), trio.Lock())
    await gathering.hand_on(1, cast(Any, SimpleNamespace(nodes=NODES)), 2)
    merge, *parts = host.asked
    assert (merge[0], merge[2]) == (NODES[4], merge_s_max(2, 1))
    assert [(node, type(packet), wait_s) for node, packet, wait_s in parts] == [(NODES[2], FilmPart, PART_S_MAX)] * 2
