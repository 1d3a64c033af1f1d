"""If this failed, each datagram of a flood would cost a node a round of all its tasks, or a flood would keep those from their turn."""

from __future__ import annotations

import pytest
import trio
import trio.testing

from conformance.world.makers import RealWorlds
from scenefold.world import Datagrams, Priority
from scenefold.world.real.datagrams import AT_ONCE_MAX

HIGH = Priority.HIGH
COUNT = 4 * AT_ONCE_MAX


async def heard_and_said() -> tuple[Datagrams, Datagrams]:
    """A socket with datagrams in its queue, and who has sent them."""
    worlds = RealWorlds()
    hearer, sender = [await worlds.node(number).network.open_datagrams(worlds.address(number), HIGH) for number in (0, 1)]
    for number in range(COUNT):
        await sender.send(b"%d" % number, worlds.address(0))
    return hearer, sender


async def test_what_is_there_is_taken_in_lumps_and_others_have_their_turn_in_between() -> None:
    hearer, sender = await heard_and_said()
    rounds = 0

    async def another() -> None:
        nonlocal rounds
        while True:
            await trio.lowlevel.checkpoint()
            rounds += 1

    async with trio.open_nursery() as nursery:
        nursery.start_soon(another)
        heard = [await hearer.receive() for _ in range(COUNT)]
        # In the first turn it only begins, and in the last one it may come after us.
        assert COUNT // AT_ONCE_MAX - 2 <= rounds <= COUNT // 4
        nursery.cancel_scope.cancel()
    assert heard == [(b"%d" % number, sender.here) for number in range(COUNT)]
    await hearer.aclose()
    await sender.aclose()


async def test_who_is_cancelled_within_a_lump_loses_nothing() -> None:
    hearer, sender = await heard_and_said()
    assert (await hearer.receive())[0] == b"0"
    with trio.CancelScope() as scope:
        scope.cancel()
        await hearer.receive()
    assert scope.cancelled_caught
    assert (await hearer.receive())[0] == b"1"
    await hearer.aclose()
    await sender.aclose()


async def test_what_was_taken_and_not_asked_for_ends_with_the_socket() -> None:
    hearer, sender = await heard_and_said()
    await hearer.receive()
    await hearer.aclose()
    with pytest.raises(trio.ClosedResourceError):
        await hearer.receive()
    await sender.aclose()


async def test_who_waits_when_the_socket_is_closed_is_told() -> None:
    worlds = RealWorlds()
    hearer = await worlds.node(0).network.open_datagrams(worlds.address(0), HIGH)
    async with trio.open_nursery() as nursery:

        async def wait() -> None:
            with pytest.raises(trio.ClosedResourceError):
                await hearer.receive()

        nursery.start_soon(wait)
        await trio.testing.wait_all_tasks_blocked()
        await hearer.aclose()
