"""If one fails, nodes speak more or less often than the odds of who is alive assume, or parts of a table are never told."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from itertools import groupby, pairwise
from math import sqrt

import pytest
import trio

from scenefold.base.ids import address_of
from scenefold.base.limits import DATAGRAM_BYTES_MAX
from scenefold.wire import PingBroadcast, Status, encode_packet
from unit.peer.village import Village, node_at, village
from unit.peer.voices import opened

SIGMAS = 4.5
"""Of a fair throw, one in 150,000 lies beyond; the dice are seeded, so a run that passes once always does."""


def broadcasts(sent: Iterable[tuple[str, str, bytes]]) -> list[tuple[str, PingBroadcast, int, set[str]]]:
    """Throws of the dice that said yes: by whom, what, its bytes, and to whom."""
    found = []
    told = [(source, opened(source, target, data), len(data), target) for source, target, data in sent]
    for (source, packet, size), copies in groupby(told, key=lambda one: one[:3]):
        if isinstance(packet, PingBroadcast) and packet.request_id == 0:
            found.append((source, packet, size, {target for *_, target in copies}))
    return found


async def settled(them: Village, count: int) -> None:
    for index in range(count):
        await them.start(index)
    for index in range(count):
        await them.of(index).gossip.everybody_heard()
    # The first arcs have been told.
    await trio.sleep(10.0)
    them.ether.sent.clear()


@pytest.mark.parametrize(("count", "seconds"), [(2, 600), (4, 800), (8, 600)])
async def test_each_node_broadcasts_once_a_second_with_probability_one_nth(
    count: int, seconds: int, autojump_clock: trio.testing.MockClock
) -> None:
    async with village(count) as them:
        await settled(them, count)
        await trio.sleep(seconds)
        said = broadcasts(them.ether.sent)
        everybody = {address_of(node_at(index)) for index in range(count)}
        assert all(targets == everybody - {source} for source, _, _, targets in said), "to every other member"

        def bounds(throws: int) -> tuple[float, float]:
            spread = SIGMAS * sqrt(throws / count * (1 - 1 / count))
            return throws / count - spread, throws / count + spread

        low, high = bounds(count * seconds)
        assert low <= len(said) <= high, "once a second in all"
        low, high = bounds(seconds)
        by_node = Counter(source for source, _, _, _ in said)
        assert all(low <= by_node[source] <= high for source in everybody), "and all of them equally often"


async def test_what_was_thrown_depends_on_the_nodes_on_the_line_and_not_on_who_runs(autojump_clock: trio.testing.MockClock) -> None:
    async with village(10) as them:
        for index in range(2):
            await them.start(index)
        await trio.sleep(10.0)
        them.ether.sent.clear()
        await trio.sleep(1000)
        throws, chance = 2 * 1000, 1 / 10
        spread = SIGMAS * sqrt(throws * chance * (1 - chance))
        assert abs(len(broadcasts(them.ether.sent)) - throws * chance) <= spread


async def test_a_table_goes_round_in_full_datagrams(autojump_clock: trio.testing.MockClock) -> None:
    count, speaker = 25, address_of(node_at(3))
    async with village(count) as them:
        await settled(them, count)
        # Answers to questions are pages of the same round: with nobody to ask, all pages are seen here.
        for index in set(range(count)) - {3}:
            them.crash(index)
        await trio.sleep(1200)
        said = [(packet, size) for source, packet, size, _ in broadcasts(them.ether.sent) if source == speaker]
        assert len(said) > 12
        assert all(packet.statuses[0].node == node_at(3) for packet, _ in said), "its own first"
        told = [status.node for packet, _ in said for status in packet.statuses[1:]]
        others = count - 1
        assert set(told[:others]) == {node_at(index) for index in range(count)} - {node_at(3)}
        assert all(one == other for one, other in zip(told, told[others:], strict=False)), "always in the same order, none left out"
        assert max(size for _, size in said) <= DATAGRAM_BYTES_MAX
        for (_, size), (following, _) in pairwise(said):
            assert size + bytes_of(following.statuses[1]) > DATAGRAM_BYTES_MAX - 16, "another would have found room"


async def test_each_own_status_is_a_new_one(autojump_clock: trio.testing.MockClock) -> None:
    async with village(3) as them:
        await settled(them, 3)
        await trio.sleep(100)
        for source in (address_of(node_at(index)) for index in range(3)):
            times = [packet.statuses[0].lamport for who, packet, _, _ in broadcasts(them.ether.sent) if who == source]
            assert len(times) > 10 and times == sorted(set(times))


def bytes_of(status: Status) -> int:
    return len(encode_packet(PingBroadcast((status,)))) - len(encode_packet(PingBroadcast(())))
