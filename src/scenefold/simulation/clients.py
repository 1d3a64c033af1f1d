"""Clients of a simulated cluster: the real client's classes, with keys in memory and links that are looked on."""

from __future__ import annotations

import hashlib
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from scenefold.base.errors import LocalFault
from scenefold.client.calls import Calls
from scenefold.client.scene import Scene
from scenefold.client.scenes import Scenes
from scenefold.crypto import MemberSecrets, SealingKey, SigningKey
from scenefold.scene.log import Decider
from scenefold.simulation.copying import KEPT_NAMES, KEPT_OBJECTS, Copying, Rule
from scenefold.simulation.heard_copies import HeardCopies, Shape
from scenefold.simulation.recording import Recorder
from scenefold.simulation.watch import Watch
from scenefold.simulation.watched_links import WatchedLinks
from scenefold.world import World, background_tasks, open_links
from scenefold.world.facts import ClusterFacts
from scenefold.world.keyring import KeptScene


class MemoryKeyring:
    """What `Scenes` asks of a keyring, without files. All clients of a run share one, as people share a profile."""

    def __init__(self) -> None:
        self._kept: dict[str, KeptScene] = {}

    def names(self) -> list[str]:
        return sorted(self._kept)

    def load(self, name: str) -> KeptScene:
        if name not in self._kept:
            raise LocalFault(f"there is no scene {name!r}")
        return self._kept[name]

    def save(self, kept: KeptScene) -> None:
        self._kept[kept.name] = kept

    def advance(self, kept: KeptScene) -> None:
        known = self._kept.get(kept.name)
        if known is not None and known.genesis == kept.genesis and known.position < kept.position:
            self.save(kept)

    def remove(self, name: str) -> None:
        self._kept.pop(name, None)


def secrets_of(writer: SigningKey) -> MemberSecrets:
    """A member that signs with this key; what is sealed to it follows from it, as all does from the seed of a run."""
    return MemberSecrets(writer, SealingKey(hashlib.sha256(b"sealing key" + writer.seed).digest()))


class Client:
    """One user at work."""

    def __init__(self, name: str, calls: Calls, scenes: Scenes) -> None:
        self.name = name
        self.calls = calls
        self.scenes = scenes
        self.scene: Scene | None = None


async def keep_copies(scene: Scene, copying: Copying, watch: Watch) -> None:
    """Make the spaces whose records have copies, and say to the judge what holds for them."""
    options = {"dimensions": 1, "copies": copying.copies, "copies_min": copying.least}
    for number, name in KEPT_NAMES.items():
        await scene.create_space(name, space_id=number, node_managed=number == KEPT_OBJECTS, **options)  # type: ignore[arg-type]
    found = await scene.spaces()
    for number in KEPT_NAMES:
        shadows = sorted((space for space in found if space.parent == number), key=lambda space: space.id)
        watch.keeping.rules[scene.id, number] = Rule(tuple(space.offset for space in shadows), copying.least)
    watch.keeping.racks = copying.racks
    shape, alone = Shape(copying.copies, copying.least), Shape(1, 1)
    watch.recorder.copies = HeardCopies(lambda place: shape if watch.keeping.has(place) else alone, watch.is_lied_about_by)
    watch.tell(None, "{}", copying)


@asynccontextmanager
async def open_client(
    name: str,
    world: World,
    facts: ClusterFacts,
    keyring: MemoryKeyring,
    writer: SigningKey,
    recorder: Recorder,
    member: str = "user:owner",
) -> AsyncIterator[Client]:
    """A client that knows what its profile would tell it. `member`: whose keys it works with."""
    founders = [one for node in facts.founders if (one := facts.credential(node)) is not None]
    origin = next(Decider(one.node_id, one.public_key.raw) for one in founders if one.node_id == facts.voter)
    async with open_links(world) as links, background_tasks() as nursery:
        watched = WatchedLinks(links, recorder, name)
        calls = Calls(world, watched, [one.address for one in founders], [one.node_id for one in founders])  # type: ignore[arg-type]
        nursery.start_soon(calls.leases.run)
        yield Client(name, calls, Scenes(calls, keyring, secrets_of(writer), origin, member))  # type: ignore[arg-type]
