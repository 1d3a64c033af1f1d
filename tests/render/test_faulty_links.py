"""If this fails, a packet between nodes that is lost, doubled, reordered or late leaves a pass open for ever, or changes the image.

All that rides on links is treated so, and what acknowledges it; packets that have an answer are not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pytest
import trio

from scenefold.base.errors import PeerFault, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.render.job import RenderOptions
from scenefold.render.pool import dealing, member, organiser
from scenefold.render.pool.incoming import Batch
from scenefold.render.pool.links import link, receiver, round_trip, sender
from scenefold.render.pool.request import organiser_of
from scenefold.render.pool.still_open import StillOpen
from scenefold.render.rehearsal.faults import Faults, FaultyPool
from scenefold.render.rehearsal.pool import Records, memory_pool, running, sha256_of
from scenefold.wire import AcknowledgeRays, Packet, SendRays
from scenefold.world.real.world import offline_world

OPTIONS = RenderOptions(width=160, height=120, samples=16, seed=3, sky=(0.2, 0.3, 0.5), algorithm="kd")
JOB = 11


@pytest.fixture(scope="module")
def alone(room: Records) -> str:
    async def render() -> str:
        async with memory_pool(offline_world(), room, 1) as pool:
            image, _ = await pool.render(JOB, OPTIONS)
        return sha256_of(image)

    return trio.run(render)


@pytest.fixture(autouse=True)
def is_quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """These jobs are short."""
    monkeypatch.setattr(organiser, "POLL_S", 0.01)
    monkeypatch.setattr(round_trip, "RTO_S_MIN", 0.1)
    monkeypatch.setattr(receiver, "DELAY_S", 0.01)


FAULTS = {
    "lost": Faults(lost=0.05),
    "doubled": Faults(doubled=0.05),
    "late": Faults(late=0.3),
    "all": Faults(lost=0.2, doubled=0.2, late=0.3),
}


@pytest.mark.parametrize("faults", FAULTS.values(), ids=FAULTS)
@pytest.mark.parametrize("moving", [False, True], ids=["fixed", "moving"])
@pytest.mark.parametrize("nodes", [2, 5])
async def test_the_image_is_the_same(
    room: Records, alone: str, nodes: int, moving: bool, faults: Faults, request: pytest.FixtureRequest
) -> None:
    if moving:
        request.getfixturevalue("ends_moved")
    async with running(FaultyPool(offline_world(), room, nodes, faults)) as pool:
        image, state = await pool.render(JOB, replace(OPTIONS, moving=moving))
        assert image and sha256_of(image) == alone
    told = state["nodes"]
    assert sum(node["rays_sent"] for node in told) == sum(node["rays_received"] for node in told)
    assert state["moved"] >= 1 or not moving
    if faults.lost > 0.1 and nodes == 5:
        # Of a few packets none may be lost, or none but the last words, which nobody waits for.
        assert pool.dropped[SendRays.__name__] and sum(node["packets_resent"] for node in told)
    assert not [error for error in pool.complaints if "takes no part" not in str(error)]


async def test_without_faults_nothing_is_sent_twice_and_little_is_added(room: Records, alone: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(round_trip, "RTO_S_MIN", 8.0)
    async with running(FaultyPool(offline_world(), room, 5)) as pool:
        image, state = await pool.render(JOB, replace(OPTIONS, moving=False))
    assert sha256_of(image) == alone
    assert sum(node["packets_resent"] for node in state["nodes"]) == 0
    on_links = sum(pool.carried.values()) - pool.carried["AcknowledgeRays"]
    assert pool.carried["AcknowledgeRays"] < on_links


async def test_what_was_told_twice_is_not_counted_twice(room: Records, alone: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every packet comes three times."""

    class Thrice(FaultyPool):
        async def carry(self, peer: str, node: NodeId, packet: Packet) -> None:
            for _ in range(3):
                await super().carry(peer, node, packet)

    monkeypatch.setattr("scenefold.render.rehearsal.pool.MemoryPool", Thrice)
    async with memory_pool(offline_world(), room, 2) as pool:
        image, state = await pool.render(JOB, OPTIONS)
    assert sha256_of(image) == alone
    assert sum(node["rays_sent"] for node in state["nodes"]) == sum(node["rays_received"] for node in state["nodes"])


async def test_what_is_ill_formed_does_not_count_nor_does_its_number(room: Records, alone: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Before every packet of rays comes one of its number that is cut off."""

    class Spoilt(FaultyPool):
        async def carry(self, peer: str, node: NodeId, packet: Packet) -> None:
            if isinstance(packet, SendRays) and packet.rays:
                await super().carry(peer, node, replace(packet, rays=packet.rays[:-1]))
            await super().carry(peer, node, packet)

    monkeypatch.setattr("scenefold.render.rehearsal.pool.MemoryPool", Spoilt)
    monkeypatch.setattr(round_trip, "RTO_S_MIN", 8.0)
    async with memory_pool(offline_world(), room, 2) as pool:
        image, state = await pool.render(JOB, OPTIONS)
        assert sum("ill-formed" in str(error) for error in pool.complaints) >= sum(node["packets_sent"] for node in state["nodes"]) > 0
    assert sha256_of(image) == alone
    assert sum(node["packets_resent"] for node in state["nodes"]) == 0


@pytest.mark.parametrize("algorithm", ["voronoi", "whole"])
async def test_what_finds_no_room_does_not_count_and_is_sent_again(
    room: Records, alone: str, algorithm: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A slow node's rays wait for as long as they have to. Only frames with rays are refused: without the others an image comes, too."""
    frames = refused = 0

    def full_in_between(batches: Sequence[Batch], *_: object) -> None:
        nonlocal frames, refused
        if batches:
            frames += 1
            if frames % 3 == 1:
                refused += 1
                raise PeerFault("more rays came than open passes have")

    monkeypatch.setattr(member, "check_room", full_in_between)
    # Where paths are dealt: from the first pass on, since everybody is presumed to have nothing else to do.
    monkeypatch.setattr(dealing, "TRIP_S", 0.0)
    monkeypatch.setattr(dealing, "PART_RAYS_MIN", 1)
    monkeypatch.setattr(StillOpen, "release", lambda self, until: [0] * self._nodes)
    monkeypatch.setattr(round_trip, "RTO_S_MIN", 0.05)
    async with memory_pool(offline_world(), room, 2) as pool:
        image, state = await pool.render(JOB, replace(OPTIONS, algorithm=algorithm))
    assert sha256_of(image) == alone
    assert sum(node["packets_resent"] for node in state["nodes"]) >= refused > 0


@pytest.mark.expect_log("1 of 2 nodes go on")
@pytest.mark.parametrize("kind", [SendRays, AcknowledgeRays], ids=["rays", "acknowledgements"])
@pytest.mark.parametrize("is_unreachable", [False, True], ids=["lost", "unreachable"])
async def test_a_link_that_is_not_mended_costs_the_node_that_does_not_organise(
    room: Records, alone: str, kind: type[Packet], is_unreachable: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From one node to another nothing gets through; all questions do."""

    class Cut(FaultyPool):
        async def carry(self, peer: str, node: NodeId, packet: Packet) -> None:
            if not isinstance(packet, kind):
                if isinstance(packet, SendRays):
                    # Acknowledgements ride on it, too.
                    packet = replace(packet, all_until=0, selective=b"")
                await super().carry(peer, node, packet)
            elif is_unreachable:
                raise Unreachable("the node does not answer")

    monkeypatch.setattr(sender, "GIVE_UP_S", 0.5)
    monkeypatch.setattr(link, "GIVE_UP_S", 0.5)
    # Else all rays of so small an image may be under way before anything is missed.
    monkeypatch.setattr(sender, "BYTES_MAX", 1 << 16)
    monkeypatch.setattr("scenefold.render.rehearsal.pool.MemoryPool", Cut)
    async with memory_pool(offline_world(), room, 2) as pool:
        image, state = await pool.render(JOB, replace(OPTIONS, moving=False))
        assert state["lost"] == [address_of(node) for node in pool.nodes if node != organiser_of(JOB, pool.nodes)]
    assert sha256_of(image) == alone
