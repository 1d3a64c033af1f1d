"""If this failed, what rots on the disk of a node that runs would be found by whoever needs it, once nobody has it any more."""

from __future__ import annotations

from random import Random

import pytest
import trio

from scenefold.peer.scrub import scrub
from scenefold.peer.scrub.pace import REST_S
from scenefold.peer.scrub.scrub import START_S
from scenefold.store.layout import RECORDS, location_of, record_key, space_of
from scenefold.world.sim import SimNet, run_simulated
from simulation.quiet import FOUNDERS, Rest, at_rest
from simulation.studio import Studio
from unit.store.samples import place, put

SOON_S = 120.0
"""When a scrub begins, instead of START_S: the cluster is at rest by then, and a few seconds later everything was read."""
HEALED_S_MAX = 60.0
KEPT = b"kept by all" * 500
"""What rots of it is not the header, which others than a scrub would meet."""


@pytest.mark.expect_log("changed on the disk")
def test_a_node_finds_what_has_rotted_tells_of_it_and_goes_on_after_a_restart() -> None:
    async def main(net: SimNet) -> None:
        async with trio.open_nursery() as nursery:
            studio = Studio(net, 1, nursery)
            await studio.start(0)
            await studio.joined()
            await studio.of(0).store.put([put(number << 140, size=6_000) for number in range(100)])
            rotten = place(70 << 140)
            assert studio.nodes[0].disk.corrupt(RECORDS, Random(1), record_key(rotten)) is not None
            await trio.sleep(START_S / 2)
            assert studio.of(0).store.damaged == 0
            await trio.sleep(START_S / 2 + REST_S)
            assert (studio.of(0).scrub.found, studio.of(0).store.damaged) == (1, 1)
            told = studio.of(0).scrub.progress(600_000).document()
            assert (told["round"], told["rotten_before"]) == (2, 1)
            studio.stop(0)
            await studio.start(0)
            await trio.sleep(START_S + 1)
            assert studio.of(0).scrub.progress(600_000).round >= 2, "the note says so"
            nursery.cancel_scope.cancel()

    async def play() -> None:
        await main(SimNet(3))

    run_simulated(3, play)


def test_what_a_scrub_finds_comes_back_from_copies(monkeypatch: pytest.MonkeyPatch) -> None:
    """At an owner, and at holders; nobody else asks for it."""
    monkeypatch.setattr(scrub, "START_S", SOON_S)

    async def look(rest: Rest) -> None:
        nodes = [rest.cluster.nodes[slot] for slot in range(FOUNDERS)]
        space = await rest.scene.create_space("copied", dimensions=1, copies=FOUNDERS)

        def keys(slot: int) -> list[bytes]:
            return sorted(key for key in nodes[slot].disk.peek(RECORDS) if space_of(key) == (rest.scene.id, space.id))

        for at in rest.places:
            await space.put(at, KEPT)
        with trio.fail_after(HEALED_S_MAX):
            while any(len(keys(slot)) < len(rest.places) for slot in range(FOUNDERS)):  # noqa: ASYNC110 - disks tell nobody
                await trio.sleep(0.2)
        # On each disk another one rots: the first node owns two of them, and the second one holds one of these.
        rotten = sorted(keys(0), key=lambda key: not nodes[0].owns(location_of(key)))[:FOUNDERS]
        assert [nodes[0].owns(location_of(key)) for key in rotten] == [True, True, False]
        for node, key in zip(nodes, rotten, strict=True):
            assert node.disk.corrupt(RECORDS, Random(1), key) == key
        await trio.sleep(SOON_S - 1 - rest.cluster.net.now)
        assert [list(node.disk.rotten(RECORDS)) for node in nodes] == [[key] for key in rotten], "nobody has met it"
        with trio.fail_after(HEALED_S_MAX):
            while any(node.disk.rotten(RECORDS) for node in nodes):  # noqa: ASYNC110 - disks tell nobody
                await trio.sleep(0.2)
        contexts = [node.context for node in nodes if node.context is not None]
        assert [context.scrub.found for context in contexts] == [1] * FOUNDERS
        assert [context.line.parts.events["healed"] for context in contexts] == [1] * FOUNDERS
        assert [await space.get(at) for at in rest.places] == [KEPT] * len(rest.places)

    at_rest(look)
