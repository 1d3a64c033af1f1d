"""A scene: its spaces, its content as a whole, and the import of a file into it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from scenefold.base.ids import SceneId, SpaceId
from scenefold.client.access import SceneAccess
from scenefold.client.importing import ImportReport, prepare_import, store_import
from scenefold.client.progress import ProgressCallback, callback_of
from scenefold.client.space import Space
from scenefold.scene.layout import DOCUMENT_LOCATION, META

if TYPE_CHECKING:
    from scenefold.scene.payloads.document import SceneDocument


@dataclass(frozen=True, slots=True)
class SceneInfo:
    """What a scene is, and what it holds; `content` None: nothing was imported yet, or not to its end."""

    name: str
    id: SceneId
    genesis: bytes
    content: SceneDocument | None

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        known: dict[str, Any] = {"name": self.name, "scene": f"{self.id:08x}", "genesis": self.genesis.hex()}
        content = self.content
        if content is None:
            return known | {"has_content": False}
        return known | {
            "has_content": True,
            "source": content.source,
            "counts": dict(content.counts),
            "world_low": content.world_low.tolist(),
            "world_high": content.world_high.tolist(),
            "default_camera": content.default_camera,
            "content_sha256": content.content.hex(),
            "not_carried": list(content.not_carried),
        }


class Scene:
    """Made by `cluster.scenes`, or by `open_scene_with_keys`."""

    def __init__(self, access: SceneAccess) -> None:
        self.access = access
        self.name = access.name

    @property
    def id(self) -> SceneId:
        return self.access.identity.scene

    @property
    def genesis(self) -> bytes:
        return self.access.identity.genesis

    def space(self, space_id: int) -> Space:
        """A space by its number (scenefold.scene.layout)."""
        return Space(self.access, SpaceId(space_id))

    async def content(self) -> SceneDocument | None:
        """The scene document, from which all tables are found; None if no import was completed yet."""
        from scenefold.scene.payloads.document import decode_document

        payload = await self.space(META).get(DOCUMENT_LOCATION)
        return None if payload is None else decode_document(payload)

    async def info(self) -> SceneInfo:
        """What the scene is and holds."""
        return SceneInfo(self.name, self.id, self.genesis, await self.content())

    async def import_file(self, path: Path | str, progress: ProgressCallback | bool = False) -> ImportReport:
        """Read a glTF, GLB, OBJ, PLY or STL file and store it as this scene's content.

        The content becomes visible at once when everything is durable, and not before. An interrupted import is
        repeated by calling this again; what is there already is kept. LocalFault says what is wrong with a file.
        `progress`: a function that is told of every step, or True to have the phases in the log.
        """
        tell = callback_of(progress)
        prepared = await prepare_import(self.access.calls.world, Path(path), tell)
        return await store_import(self.access, prepared, tell)
