"""Clients of a simulated cluster: the real client's classes, with keys in memory and links that are looked on."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from scenefold.base.errors import LocalFault
from scenefold.base.ids import NodeId
from scenefold.client.calls import Calls
from scenefold.client.scene import Scene
from scenefold.client.scenes import Scenes
from scenefold.crypto import SigningKey
from scenefold.simulation.recording import Recorder, WatchedLinks
from scenefold.world import World, open_links
from scenefold.world.keyring import SceneKeys


class MemoryKeyring:
    """What `Scenes` asks of a keyring, without files. All clients of a run share one, as people share a profile."""

    def __init__(self) -> None:
        self._keys: dict[str, SceneKeys] = {}

    def names(self) -> list[str]:
        return sorted(self._keys)

    def load(self, name: str) -> SceneKeys:
        if name not in self._keys:
            raise LocalFault(f"there is no scene {name!r}")
        return self._keys[name]

    def save(self, keys: SceneKeys) -> None:
        self._keys[keys.name] = keys

    def remove(self, name: str) -> None:
        self._keys.pop(name, None)


class Client:
    """One user at work."""

    def __init__(self, name: str, calls: Calls, scenes: Scenes) -> None:
        self.name = name
        self.calls = calls
        self.scenes = scenes
        self.scene: Scene | None = None


@asynccontextmanager
async def open_client(
    name: str, world: World, founders: list[tuple[NodeId, str]], keyring: MemoryKeyring, writer: SigningKey, recorder: Recorder
) -> AsyncIterator[Client]:
    """A client that knows the founders, as its profile would tell it."""
    async with open_links(world) as links:
        watched = WatchedLinks(links, recorder, name)
        calls = Calls(world, watched, [address for _, address in founders], [node for node, _ in founders])  # type: ignore[arg-type]
        yield Client(name, calls, Scenes(calls, keyring, writer, founders[0][0]))  # type: ignore[arg-type]
