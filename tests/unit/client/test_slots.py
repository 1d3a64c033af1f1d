"""If one fails, who wants one record waits for who wants thousands, or a client has too much on its way."""

from __future__ import annotations

import trio
from trio.testing import MockClock

from scenefold.base.limits import CLIENT_FRAMES_IN_FLIGHT, CLIENT_FRAMES_PER_NODE, CLIENT_SMALL_PER_NODE, CLIENT_SMALL_RECORDS
from scenefold.client.slots import Slots

NODES = [f"127.0.0.{number}" for number in range(2, 12)]


async def most_at_once(addresses: list[str], records: int) -> tuple[int, int]:
    """Of many questions: how many are under way together, and to one node."""
    slots, under_way = Slots(), dict.fromkeys(addresses, 0)
    most = most_of_one = 0

    async def ask(address: str) -> None:
        nonlocal most, most_of_one
        async with slots.turn(address, records):
            under_way[address] += 1
            most, most_of_one = max(most, sum(under_way.values())), max(most_of_one, under_way[address])
            await trio.sleep(1)
            under_way[address] -= 1

    async with trio.open_nursery() as nursery:
        for address in addresses:
            for _ in range(2 * CLIENT_SMALL_PER_NODE):
                nursery.start_soon(ask, address)
    return most, most_of_one


async def test_large_ones_are_bounded_for_each_node_and_in_all(autojump_clock: MockClock) -> None:
    assert await most_at_once(NODES, CLIENT_SMALL_RECORDS + 1) == (CLIENT_FRAMES_IN_FLIGHT, CLIENT_FRAMES_PER_NODE)
    assert await most_at_once(NODES[:1], 64) == (CLIENT_FRAMES_PER_NODE, CLIENT_FRAMES_PER_NODE)


async def test_small_ones_are_bounded_for_each_node(autojump_clock: MockClock) -> None:
    assert await most_at_once(NODES, CLIENT_SMALL_RECORDS) == (len(NODES) * CLIENT_SMALL_PER_NODE, CLIENT_SMALL_PER_NODE)


async def test_a_small_one_does_not_wait_for_large_ones(autojump_clock: MockClock) -> None:
    slots = Slots()

    async def ask_for_much() -> None:
        async with slots.turn(NODES[0]):
            await trio.sleep(100)

    async with trio.open_nursery() as nursery:
        for _ in range(CLIENT_FRAMES_PER_NODE + 1):
            nursery.start_soon(ask_for_much)
        await trio.sleep(1)
        with trio.fail_after(1):
            async with slots.turn(NODES[0], 1):
                nursery.cancel_scope.cancel()
