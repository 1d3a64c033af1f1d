"""Clusters for tests: nodes in this process with real TLS, UDP and LMDB, on ports that the system picks."""

from __future__ import annotations

from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import trio

from loopback import addresses, free_ports
from scenefold.base.errors import LocalFault
from scenefold.node import NodeContext, NodeSettings, run_node
from scenefold.world import Links, World, background_tasks, open_links, real_world
from scenefold.world.profile import ClusterProfile

PATIENCE_S = 20.0


class Nodes:
    """Nodes of one profile in this process, by number."""

    def __init__(self, folder: Path, profile: ClusterProfile, nursery: trio.Nursery) -> None:
        self.folder = folder
        self.profile = profile
        self.contexts: dict[int, NodeContext] = {}
        self._nursery = nursery
        self._scopes: dict[int, trio.CancelScope] = {}
        self._ended: dict[int, trio.Event] = {}
        self.revoked: set[int] = set()
        """Nodes whose key a test revokes: each ends itself as soon as it hears of it."""

    def settings(self, index: int, **changes: Any) -> NodeSettings:
        address = self.profile.members[index].address
        known: dict[str, Any] = {
            "profile_folder": self.profile.folder,
            "address": address,
            "data_folder": self.folder / "data" / address,
            # Tests that ask nodes with bare packets and no second try need bounds that stand still.
            "balance": False,
        }
        return NodeSettings(**{**known, **changes})

    async def start(self, *numbers: int) -> None:
        for index in numbers:
            self.contexts[index] = await self._nursery.start(self._run, index)

    async def joined(self) -> None:
        with trio.fail_after(PATIENCE_S):
            for context in self.contexts.values():
                await context.joined.wait()

    async def stop(self, index: int) -> None:
        self._scopes[index].cancel()
        await self._ended[index].wait()
        del self.contexts[index]

    async def _run(self, index: int, *, task_status: trio.TaskStatus[NodeContext]) -> None:
        self._ended[index] = trio.Event()
        with trio.CancelScope() as self._scopes[index]:
            try:
                await run_node(self.settings(index), extensions=(), task_status=task_status)
            except LocalFault as fault:
                if index not in self.revoked or "the key of this node was revoked" not in str(fault):
                    raise
        self._ended[index].set()


@asynccontextmanager
async def nodes_here(
    folder: Path, count: int = 3, *, start: Sequence[int] | None = None, profile: ClusterProfile | None = None
) -> AsyncIterator[Nodes]:
    """A new cluster in `folder`, or that of a profile, of which the nodes of these numbers (all) run and have joined."""
    profile = profile or ClusterProfile.create(folder / "profile", "trial", addresses(count), ports=free_ports(addresses(count)))
    async with background_tasks() as nursery:
        nodes = Nodes(folder, profile, nursery)
        await nodes.start(*(range(count) if start is None else start))
        if start is None:
            await nodes.joined()
        yield nodes


def world_of_user(profile: ClusterProfile) -> World:
    return real_world(profile.user_identity(), profile.authority_certificate(), ports=profile.ports)


@asynccontextmanager
async def links_of_user(profile: ClusterProfile) -> AsyncIterator[Links]:
    """What a client that speaks bare packets asks on."""
    async with open_links(world_of_user(profile)) as links:
        yield links
