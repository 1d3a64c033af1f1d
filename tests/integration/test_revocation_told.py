"""If this fails, a client goes on talking to a node whose key was revoked, or is not told that its own was."""

from __future__ import annotations

import logging
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path

import pytest
import trio

from integration.clusters import PATIENCE_S, nodes_here
from loopback import addresses
from scenefold.base.errors import LocalFault, Refused, Unreachable
from scenefold.base.ids import node_id_of
from scenefold.base.reasons import RejectReason
from scenefold.client import Cluster, connect
from scenefold.client.enrolling import enrol
from scenefold.wire import RequestTable, RespondTable
from scenefold.world import Connection, ConnectionLost, Priority, background_tasks, real_world
from scenefold.world.profile import ClusterProfile

FIRST, _, THIRD = addresses(3)
AGAIN_S = 0.1


@pytest.fixture
def quiet_nodes() -> Iterator[None]:
    """What nodes complain of depends on how much a revoked one gets to say before it is told."""
    nodes = logging.getLogger("scenefold.peer")
    level = nodes.level
    nodes.setLevel(logging.CRITICAL)
    yield
    nodes.setLevel(level)


async def ask(cluster: Cluster, address: str) -> None:
    await cluster.calls.ask(address, RequestTable(), RespondTable)


async def ask_for_ever(cluster: Cluster) -> None:
    while True:
        await cluster.nodes()
        await trio.sleep(AGAIN_S)


async def told(cluster: Cluster, name: str) -> None:
    """Return once the client has heard, from whom it asks for something else, that the cluster revoked a key of this name."""
    with trio.fail_after(PATIENCE_S):
        while name not in [revoked for revoked, _ in cluster.log.view.roll.revoked]:
            await ask(cluster, FIRST)
            await trio.sleep(AGAIN_S)


async def not_talked_to(cluster: Cluster, address: str) -> None:
    """It is never answered to, and that is said as soon as the client dials again: it waits a moment after a dial that failed."""
    problem = ""
    with trio.fail_after(PATIENCE_S):
        while "is revoked" not in problem:
            with pytest.raises(Unreachable) as caught:
                await ask(cluster, address)
            problem = str(caught.value)
            await trio.sleep(AGAIN_S)


@asynccontextmanager
async def answering_as(profile: ClusterProfile, address: str) -> AsyncIterator[None]:
    """Whoever has the revoked key of a node listens at its address, as a node would that is not told or does not care."""
    world = real_world(profile.node_identity(address), profile.authority_certificate(), ports=profile.ports)

    async def hears_nothing(connection: Connection) -> None:
        with suppress(ConnectionLost):
            assert not await connection.receive(1000), "a client of the cluster spoke to a revoked node"

    async with background_tasks() as nursery:
        for priority in Priority:
            await nursery.start(world.network.listen, address, priority, hears_nothing)
        yield


@pytest.mark.usefixtures("quiet_nodes")
async def test_a_client_ends_its_connections_to_a_revoked_node_and_none_of_its_profile_opens_one(tmp_path: Path) -> None:
    async with nodes_here(tmp_path, 3) as nodes:
        nodes.revoked.add(2)
        profile, name = nodes.profile.folder, f"node:{node_id_of(THIRD)}"
        async with connect(profile) as client:
            await ask(client, THIRD)
            async with connect(profile) as office:
                assert (await office.card_of(name)).name == name
                await office.membership.revoke_node(node_id_of(THIRD))
                with pytest.raises(LocalFault, match="is revoked"):
                    await office.card_of(name)
            await told(client, name)
            with pytest.raises(Unreachable):
                await ask(client, THIRD)
            await nodes.stop(2)
            async with answering_as(nodes.profile, THIRD):
                await not_talked_to(client, THIRD)
                async with connect(profile) as later:
                    await not_talked_to(later, THIRD)


@pytest.mark.expect_log("connection refused: the key of user:ada is revoked")
async def test_a_client_whose_own_key_was_revoked_hears_so(tmp_path: Path) -> None:
    async with nodes_here(tmp_path, 2) as nodes:
        async with connect(nodes.profile.folder) as office:
            await enrol(tmp_path / "ada", await office.membership.invite("user:ada", seconds=600))
            async with connect(tmp_path / "ada") as ada:
                await ask(ada, FIRST)
                await office.membership.revoke_user("ada")
                with trio.fail_after(PATIENCE_S), pytest.raises(Refused, match=r"user:ada is revoked.*new invitation") as caught:
                    await ask_for_ever(ada)
                assert caught.value.reason is RejectReason.KEY_REVOKED
