"""If this fails, a fault is counted that did nothing, or one of two that overlap ends both."""

from __future__ import annotations

import pytest
import trio

from scenefold.simulation.cluster import Node
from scenefold.simulation.faults import Fault, Kind
from scenefold.simulation.storm import Storm
from simulation.quiet import Rest, at_rest

pytestmark = pytest.mark.usefixtures("silent")


async def no_drain(_node: Node) -> bool:
    return False


def happened(*faults: Fault, dead: tuple[int, ...] = (), after_s: float = 4.0) -> list[str]:
    """Which of these faults count, on a cluster at rest with some nodes dead."""
    counted: list[str] = []

    async def look(rest: Rest) -> None:
        for slot in dead:
            rest.cluster.crash(slot)
        async with trio.open_nursery() as nursery:
            storm = Storm(rest.cluster, no_drain, nursery)
            for fault in faults:
                nursery.start_soon(storm.befall, fault)
            await trio.sleep_until(max(fault.end_s for fault in faults) + after_s)
            storm.end()
            nursery.cancel_scope.cancel()
        counted.extend(storm.happened)

    at_rest(look)
    return counted


def on_links(kind: Kind, amount: float = 0.0) -> Fault:
    return Fault(kind, 10.0, 14.0, (1, 2), amount)


@pytest.mark.parametrize(
    "fault", [on_links(Kind.RESET, 2.0), on_links(Kind.CLOG), on_links(Kind.ONE_WAY)], ids=lambda fault: fault.kind.value
)
def test_what_hits_a_link_counts_if_there_is_one(fault: Fault) -> None:
    assert happened(fault) == [fault.kind.value]
    assert happened(fault, dead=(1, 2)) == []


def test_a_liar_that_is_dead_tells_no_lie() -> None:
    assert happened(Fault(Kind.LIAR, 10.0, 14.0, (1,), 1.0), dead=(1,)) == []


@pytest.mark.parametrize("kind", [Kind.SLOW_DISK, Kind.DISK_FULL, Kind.CLOG, Kind.SLOW_NODE, Kind.CLOCK_RATE])
def test_what_overlaps_lasts_until_the_last_of_it_ends(kind: Kind) -> None:
    slots = (1, 2) if kind is Kind.CLOG else (1,)
    amounts = (-0.005, 0.002) if kind is Kind.CLOCK_RATE else (0.7, 0.2) if kind is not Kind.SLOW_NODE else (20.0, 10.0)
    long, short = (Fault(kind, 10.0 + step, 20.0 - 4.0 * step, slots, amount) for step, amount in enumerate(amounts))
    seen: list[object] = []

    async def look(rest: Rest) -> None:
        node, net = rest.cluster.nodes[1], rest.cluster.net
        pair = node.address, rest.cluster.nodes[2].address

        def state() -> object:
            clogged = net.paths.bytes_per_s(*pair) < 1000.0
            clock = net.machine(node.address).clock
            return node.disk.sync_s, node.disk._free_bytes, clogged, net.paths.slowness(node.address), clock._rate

        async with trio.open_nursery() as nursery:
            storm = Storm(rest.cluster, no_drain, nursery)
            seen.append(state())
            for fault in (long, short):
                nursery.start_soon(storm.befall, fault)
            for at_s in (10.5, 12.0, 18.0, 21.0):
                await trio.sleep_until(at_s)
                seen.append(state())
            nursery.cancel_scope.cancel()

    at_rest(look)
    before, alone, both, alone_again, after = seen
    assert before == after != alone
    assert alone == both == alone_again, "the worse one is in force, and outlasts the other"
