"""The scenes of a cluster: made, opened, listed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from scenefold.base.errors import LocalFault, Refused
from scenefold.base.ids import NodeId, SceneId
from scenefold.client.access import SceneAccess
from scenefold.client.births import born, first_header, first_records, writers_of
from scenefold.client.calls import Calls
from scenefold.client.importing import ImportReport, PreparedImport, prepare_import, store_import
from scenefold.client.patience import is_passing
from scenefold.client.progress import ProgressCallback, callback_of, no_progress
from scenefold.client.scene import Scene
from scenefold.client.scene_log import LogAccess, LogKeys
from scenefold.client.sealing import SceneIdentity
from scenefold.crypto import SYMMETRIC_KEY_BYTES, SigningKey
from scenefold.wire import ListScenes, SceneLogPublic, ScenesListed
from scenefold.world.keyring import Keyring, SceneKeys, checked_name

Result = TypeVar("Result")

_SESSION_BYTES = 8


@dataclass(frozen=True, slots=True)
class SceneListing:
    """A scene that the cluster holds; `name` is None if this profile has no keys of it."""

    id: SceneId
    genesis: bytes
    name: str | None

    @property
    def has_key(self) -> bool:
        return self.name is not None

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        return {"name": self.name, "scene": f"{self.id:08x}", "genesis": self.genesis.hex(), "has_key": self.has_key}


class Scenes:
    """`cluster.scenes`."""

    def __init__(self, calls: Calls, keyring: Keyring, writer: SigningKey, origin: NodeId) -> None:
        """`origin`: the node that new scenes name as theirs; always the same, so that a header can be made again."""
        self._calls = calls
        self._origin = origin
        self._keyring = keyring
        self._writer = writer

    async def create(self, name: str) -> Scene:
        """Make an empty scene. Its keys are on disk, durably, before any node hears of it.

        If a creation of that name was interrupted, the scene is announced again; LocalFault if it exists already.
        """
        checked_name(name, "scene")
        keys = await self._kept(name)
        if keys is not None:
            header = await self._header(keys)
            if header is not None:
                what, where = f"a scene {name!r} exists already", f"id {keys.scene_id:08x}"
                raise LocalFault(what, where=where, remedy="choose another name, or open it")
            return await self._announce(keys)
        token = self._calls.world.entropy.token
        header_key = SigningKey.from_seed(token(32))
        keys = born(name, token(SYMMETRIC_KEY_BYTES), header_key, self._writer.public, self._origin)
        await self._on_disk(self._keyring.save, keys)
        return await self._announce(keys, is_new=True)

    async def open(self, name: str) -> Scene:
        """The scene of this name in the profile's keyring; LocalFault if the profile or the cluster has none."""
        keys = await self._on_disk(self._keyring.load, name)
        header = await self._header(keys)
        if header is None:
            remedy = f"`scenectl scene create {name}` announces it again"
            raise LocalFault("the cluster does not know this scene", where=f"scene {name}", remedy=remedy)
        return self._scene(keys, header)

    async def open_or_create(self, name: str) -> Scene:
        """Open the scene, or make it if there is none."""
        checked_name(name, "scene")
        keys = await self._kept(name)
        if keys is not None:
            header = await self._header(keys)
            return await self._announce(keys) if header is None else self._scene(keys, header)
        return await self.create(name)

    async def import_file(self, name: str, path: Path | str, progress: ProgressCallback | bool = False) -> tuple[Scene, ImportReport]:
        """Import a file into the scene of this name, made if there is none once the file is known to be good.

        See `Scene.import_file`.
        """
        checked_name(name, "scene")
        tell = callback_of(progress)
        prepared = await prepare_import(self._calls.world, Path(path), tell)
        return await self.import_prepared(name, prepared, tell)

    async def import_prepared(
        self, name: str, prepared: PreparedImport, progress: ProgressCallback = no_progress
    ) -> tuple[Scene, ImportReport]:
        """The second half of `import_file`, for a file that was read before there was a cluster."""
        scene = await self.open_or_create(name)
        return scene, await store_import(scene.access, prepared, progress)

    async def list(self) -> list[SceneListing]:
        """All scenes of the cluster, those with keys here first, by name."""
        reply = await self._calls.ask_any(ListScenes(), ScenesListed)
        names = await self._on_disk(_names_by_genesis, self._keyring)
        found = [SceneListing(header.scene, header.genesis, names.get(header.genesis)) for header in reply.scenes]
        return sorted(found, key=lambda scene: (scene.name is None, scene.name or "", scene.genesis))

    async def _on_disk(self, function: Callable[..., Result], *arguments: object) -> Result:
        return await self._calls.world.workers.run("import", function, *arguments)

    async def _kept(self, name: str) -> SceneKeys | None:
        """The keys of a scene if this profile has any."""
        names = await self._on_disk(self._keyring.names)
        return await self._on_disk(self._keyring.load, name) if name in names else None

    async def _header(self, keys: SceneKeys) -> SceneLogPublic | None:
        """The newest header that a node knows, verified; None if the cluster does not know the scene."""
        return await self._log(keys).header()

    async def _announce(self, keys: SceneKeys, *, is_new: bool = False) -> Scene:
        """Propose the first header; any node hands it on to the one that decides. Proposing it again is harmless."""
        header = first_header(keys, self._writer.public, self._origin)
        if header is None:
            what = "the scene was made by another user or for other nodes"
            raise LocalFault(what, where=f"scene {keys.name}", remedy="use the profile that made it")
        try:
            await self._log(keys).announce(header, first_records(keys, self._origin))
        except Refused as refusal:
            if is_new and not is_passing(refusal.reason):
                # The cluster has no such scene and will not have it, so its keys open nothing. Of doubt we hear as Unreachable.
                await self._on_disk(self._keyring.remove, keys.name)
            raise
        return self._scene(keys, header)

    def _scene(self, keys: SceneKeys, header: SceneLogPublic) -> Scene:
        identity = SceneIdentity(
            scene=keys.scene_id,
            genesis=keys.genesis,
            position=header.position,
            writers=writers_of(header),
            symmetric_key=keys.symmetric_key,
            key_epoch=keys.key_epoch,
        ).with_header(header)
        writer = self._writer if self._writer.key_id in identity.writers else None
        session = int.from_bytes(self._calls.world.entropy.token(_SESSION_BYTES), "big")
        return Scene(SceneAccess(self._calls, keys.name, identity, writer, session, log=self._log(keys)))

    def _log(self, keys: SceneKeys) -> LogAccess:
        header_key = SigningKey.from_seed(keys.header_seed).public
        opening = LogKeys(keys.scene_id, keys.genesis, keys.symmetric_key, keys.key_epoch, header_key, keys.header_seed)
        return LogAccess(self._calls, keys.name, opening)


def _names_by_genesis(keyring: Keyring) -> dict[bytes, str]:
    return {keys.genesis: keys.name for keys in map(keyring.load, keyring.names())}
