"""If this fails, a client goes on talking to a node whose key was revoked, or is not told that its own was."""

from __future__ import annotations

import logging
from collections.abc import Iterator
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
    """A node is never answered to; it begins its next life meanwhile, and cannot be reached for a moment."""
    problem = ""
    with trio.fail_after(PATIENCE_S):
        while "is revoked" not in problem:
            with pytest.raises(Unreachable) as caught:
                await ask(cluster, address)
            problem = str(caught.value)
            await trio.sleep(AGAIN_S)


@pytest.mark.usefixtures("quiet_nodes")
async def test_a_client_ends_its_connections_to_a_revoked_node_and_none_of_its_profile_opens_one(tmp_path: Path) -> None:
    async with nodes_here(tmp_path, 3) as nodes:
        profile, name = nodes.profile.folder, f"node:{node_id_of(THIRD)}"
        async with connect(profile) as client:
            await ask(client, THIRD)
            async with connect(profile) as office:
                assert (await office.card_of(name)).name == name
                await office.membership.revoke_node(node_id_of(THIRD))
                with pytest.raises(LocalFault, match="is revoked"):
                    await office.card_of(name)
            await told(client, name)
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
