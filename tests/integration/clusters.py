"""Clusters for tests: nodes in this process with real TLS, UDP and LMDB, on ports that the system picks."""

from __future__ import annotations

import socket
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import trio

from scenefold.node import NodeContext, NodeSettings, run_node
from scenefold.world import Links, Ports, World, background_tasks, open_links, real_world
from scenefold.world.profile import ClusterProfile

PATIENCE_S = 20.0


def addresses(count: int) -> list[str]:
    return [f"127.0.0.{2 + index}" for index in range(count)]


def free_ports(count: int = 5) -> Ports:
    """Two numbers that are free for TCP and UDP at the first `count` addresses, as of now."""
    chosen: list[int] = []
    while len(chosen) < 2:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            number = probe.getsockname()[1]
        if number not in chosen and all(_is_free(address, number) for address in addresses(count)):
            chosen.append(number)
    return Ports(*chosen)


def _is_free(address: str, number: int) -> bool:
    for kind in (socket.SOCK_STREAM, socket.SOCK_DGRAM):
        with socket.socket(socket.AF_INET, kind) as probe:
            try:
                probe.bind((address, number))
            except OSError:
                return False
    return True


class Nodes:
    """Nodes of one profile in this process, by number."""

    def __init__(self, folder: Path, profile: ClusterProfile, nursery: trio.Nursery) -> None:
        self.folder = folder
        self.profile = profile
        self.contexts: dict[int, NodeContext] = {}
        self._nursery = nursery
        self._scopes: dict[int, trio.CancelScope] = {}
        self._ended: dict[int, trio.Event] = {}

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
            await run_node(self.settings(index), extensions=(), task_status=task_status)
        self._ended[index].set()


@asynccontextmanager
async def nodes_here(folder: Path, count: int = 3, *, start: Sequence[int] | None = None) -> AsyncIterator[Nodes]:
    """A new cluster in `folder`, of which the nodes of these numbers (all) run and have joined."""
    profile = ClusterProfile.create(folder / "profile", "trial", addresses(count), ports=free_ports(count))
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
