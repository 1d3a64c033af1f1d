"""The scenes whose records are to be proved, by what their public headers say; with their keys, where the profile has them.

Nobody needs a scene's key to see that its copies are there and sound: what a writer has signed, and that the ciphertext is what was signed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from scenefold.base.errors import DamagedData, LocalFault, ScenefoldError
from scenefold.base.ids import KeyId, SceneId, SpaceId
from scenefold.client.births import verified_header_key
from scenefold.client.calls import Calls
from scenefold.client.scenes import Scenes
from scenefold.client.verifying import Key, NewerThanKnown, WriterKey, verified, writers_of
from scenefold.crypto import open_record
from scenefold.crypto.record_header import Version, version_key
from scenefold.scene.log import EpochKeys, Layouts
from scenefold.wire import RecordBytes, RequestSceneLog, RespondSceneLog, SceneLogPublic, Want


@dataclass(frozen=True, slots=True)
class ShownScene:
    """What its header tells of a scene. `keys`: None if this profile has none."""

    name: str
    scene: SceneId
    genesis: bytes
    position: int
    writers: Mapping[KeyId, WriterKey]
    layouts: Layouts
    keys: EpochKeys | None = None

    @classmethod
    def of(cls, header: SceneLogPublic) -> ShownScene:
        """By the header alone."""
        layouts = Layouts.of(header.spaces, header.scene)
        return cls(f"{header.scene:08x}", header.scene, header.genesis, header.position, writers_of(header), layouts)

    @property
    def spaces(self) -> list[SpaceId]:
        """All but shadows, which have no records of their own."""
        return sorted(self.layouts.offsets)

    def by(self, header: SceneLogPublic) -> ShownScene:
        """As a newer header tells of it."""
        return replace(self, position=header.position, writers=writers_of(header), layouts=Layouts.of(header.spaces, header.scene))


class Checked(NamedTuple):
    """What a record came to: its version if it is genuine. `epoch`: of a log position that must be known to tell, else None."""

    version: Version | None
    is_opened: bool = False
    epoch: int | None = None


def check_all(scene: ShownScene, pairs: Sequence[tuple[Key, RecordBytes]]) -> list[Checked]:
    """Each record as any reader checks it. What is equal to the byte is checked once. For a worker thread."""
    met: dict[Key, list[tuple[RecordBytes, Checked]]] = {}
    found: list[Checked] = []
    for key, record in pairs:
        known = met.setdefault(key, [])
        checked = next((checked for other, checked in known if other == record), None)
        if checked is None:
            checked = _checked(scene, key, record)
            known.append((record, checked))
        found.append(checked)
    return found


def _checked(scene: ShownScene, key: Key, found: RecordBytes) -> Checked:
    try:
        record = verified(scene, key[0], key[1], key[2] if len(key) == 3 else b"", found)
        symmetric_key = None if scene.keys is None else scene.keys.get(record.header.key_epoch)
        if symmetric_key is not None:
            open_record(record, symmetric_key)
        return Checked(version_key(record.header), symmetric_key is not None)
    except NewerThanKnown as unknown:
        return Checked(None, epoch=unknown.epoch)
    except DamagedData:
        return Checked(None)


async def shown_scenes(calls: Calls, scenes: Scenes, name: str | None) -> list[ShownScene]:
    """All scenes of the cluster, or the one of this name or id; LocalFault if there is none."""
    headers = await scenes.headers()
    found: dict[bytes, ShownScene] = {}
    for kept in await scenes.kept_names():
        try:
            identity = (await scenes.open(kept)).access.identity
        except ScenefoldError:
            # The cluster has never heard of it, or its key was changed: then its header is all there is.
            continue
        found[identity.genesis] = ShownScene(
            kept, identity.scene, identity.genesis, identity.position, identity.writers, identity.layouts, identity.keys
        )
    for header in headers:
        found.setdefault(header.genesis, await calls.world.workers.run("crypto", ShownScene.of, header))
    wanted = [scene for scene in found.values() if name in (None, scene.name, f"{scene.scene:08x}")]
    if name is not None and not wanted:
        raise LocalFault("the cluster has no such scene", where=f"scene {name}", remedy="`scenectl scene list` shows names and ids")
    return sorted(wanted, key=lambda scene: (scene.name, scene.genesis))


async def newer_scene(calls: Calls, scene: ShownScene, epoch: int) -> ShownScene:
    """As the newest header tells that some nodes show; the same if none is newer."""
    nonce = int.from_bytes(calls.world.entropy.token(8), "big")
    request = RequestSceneLog(scene.scene, scene.genesis, epoch, nonce, Want.HEADER)

    def judged(reply: RespondSceneLog) -> SceneLogPublic | None:
        header = None if reply.answer is None else reply.answer.public
        if header is None or header.genesis != scene.genesis:
            return None
        verified_header_key(header)
        return header

    try:
        shown = [header for header in await calls.opinions(request, RespondSceneLog, judged) if header is not None]
    except ScenefoldError:
        return scene
    newest = max(shown, key=lambda header: header.position, default=None)
    return scene if newest is None or newest.position <= scene.position else scene.by(newest)
