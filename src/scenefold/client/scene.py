"""A scene: its spaces, its content as a whole, and the import of a file into it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from scenefold.base.ids import NodeId, SceneId, SpaceId
from scenefold.client.access import SceneAccess
from scenefold.client.contents import content_of
from scenefold.client.ending import SceneEnd, end_scene, plan_end
from scenefold.client.exporting import ExportReport, export_scene
from scenefold.client.former_keys import LOOK_S, FormerKeys, former_keys
from scenefold.client.grants import Access, access_of, grant, plan_revoke, revoke, rotate_key
from scenefold.client.importing import ImportReport, prepare_import, store_import
from scenefold.client.log_telling import LogStory, story_of
from scenefold.client.new_space import SpaceOptions, new_space
from scenefold.client.observers import add_observer, remove_observer
from scenefold.client.participants import Deciders, add_participants, deciders_of, remove_participant
from scenefold.client.positions import logged_spaces
from scenefold.client.progress import ProgressCallback, callback_of
from scenefold.client.purge_walk import Purge
from scenefold.client.purging import purge
from scenefold.client.reencrypting import look_what_is_to_seal, reencrypt
from scenefold.client.reencryption import Reencryption
from scenefold.client.render_settings import SettingsShown, change_settings, settings_of
from scenefold.client.requests import Again
from scenefold.client.scene_log import Standing
from scenefold.client.space import Space
from scenefold.client.suspects import SuspectReport, look_at_suspects
from scenefold.scene.log import LoggedSpace

if TYPE_CHECKING:
    from scenefold.crypto import Card
    from scenefold.scene.importers import Moment
    from scenefold.scene.payloads.document import SceneDocument
    from scenefold.wire import ParticipantEntry, RenderSettings, Role


@dataclass(frozen=True, slots=True)
class SceneInfo:
    """What a scene is, and what it holds; `content` None: nothing was imported yet, or not to its end."""

    name: str
    id: SceneId
    genesis: bytes
    content: SceneDocument | None
    lacking: Mapping[SpaceId, int] = field(default_factory=dict)
    """Spaces that shall have more copies than they have shadows for, and how many they can have. Early programs made such."""

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        known: dict[str, Any] = {"name": self.name, "scene": f"{self.id:08x}", "genesis": self.genesis.hex()}
        known["spaces_lacking_shadows"] = sorted(self.lacking)
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
    """Made by `cluster.scenes`, or by `open_scene_with_keys`. What takes `again` makes one change of the scene's log; see `Change`."""

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

    async def spaces(self) -> list[LoggedSpace]:
        """All spaces by the newest log, in the order of their creation."""
        return await logged_spaces(self.access)

    async def space_named(self, name: str | int) -> Space:
        """A space by its name, or by its number; LocalFault if the scene has none such."""
        log = (await self.access.read_log()).state
        found = log.space(SpaceId(name)) if isinstance(name, int) else log.named(name)
        return self.space(found.id)

    async def create_space(
        self,
        name: str,
        box: tuple[Sequence[float], Sequence[float]] | None = None,
        *,
        again: Again = None,
        **options: Unpack[SpaceOptions],
    ) -> Space:
        """Make a space, for ever: nodes know of it from the next record on.

        `box`: low and high corner, in the world, of what its lattice spans; by default the unit box of `dimensions`
        (default: 3, or as the box has). See `SpaceOptions` for the rest. LocalFault if a space of that name or number exists.
        """
        make = new_space(name, box, **options)
        log = await self.access.change_log(make, again=again)
        made = log.state.named(name)
        return Space(self.access, made.id, made=made)

    async def content(self) -> SceneDocument | None:
        """The scene document, from which all tables are found; None if no import was completed yet."""
        return await content_of(self.access)

    async def info(self) -> SceneInfo:
        """What the scene is and holds."""
        return SceneInfo(self.name, self.id, self.genesis, await self.content(), self.access.identity.layouts.lacking())

    async def members(self) -> Access:
        """Who may use this scene, and in which role."""
        return await access_of(self.access)

    async def grant(self, card: Card, role: Role, *, again: Again = None) -> Access:
        """Let the holder of a verified card use this scene; see `grants.grant`. An owner's to do, as are the next two."""
        return await grant(self.access, card, role, again=again)

    async def revoke(self, name: str, *, dry_run: bool = False, again: Again = None) -> Access:
        """End a member's access; the scene gets a new key. `dry_run`: only say what that would leave."""
        return await (plan_revoke(self.access, name) if dry_run else revoke(self.access, name, again=again))

    async def rotate_key(self, *, again: Again = None) -> Access:
        """Seal what is written from now on under a new key. `reencrypt` does the same for what is there."""
        return await rotate_key(self.access, again=again)

    async def reencrypt(self, progress: ProgressCallback | bool = False, bytes_per_s: float | None = None) -> Reencryption:
        """Seal everything anew that lies under an older key; a writer's to do. May be cancelled, and begun again; see `reencrypting`."""
        return await reencrypt(self.access, callback_of(progress), bytes_per_s)

    async def look_what_is_to_seal(
        self, progress: ProgressCallback | bool = False, bytes_per_s: float | None = None, *, new_key: bool = False
    ) -> Reencryption:
        """What `reencrypt` would have to do, or, with `new_key`, `rotate_key` and `reencrypt`. Reads everything, and changes nothing."""
        return await look_what_is_to_seal(self.access, callback_of(progress), bytes_per_s, new_key=new_key)

    async def former_keys(self, look_s: float = LOOK_S) -> FormerKeys:
        """Whether records lie under older keys still: a revocation's work that was left, or ended. Looks for `look_s` at most."""
        return await former_keys(self.access, look_s)

    async def purge(
        self,
        spaces: Sequence[int] = (),
        *,
        dry_run: bool = False,
        progress: ProgressCallback | bool = False,
        bytes_per_s: float | None = None,
    ) -> Purge:
        """Have deleted records dropped for good, of these spaces or all; a writer's to do, and an owner's for what is newer than the last purge.

        They go only once no node has anything older. May be cancelled, and begun again; see `purging`. `bytes_per_s`: of what is looked at.
        """
        wanted, tell = [SpaceId(space) for space in spaces], callback_of(progress)
        return await purge(self.access, wanted, dry_run=dry_run, progress=tell, bytes_per_s=bytes_per_s)

    async def strays(self, *, restore: bool = False, discard: bool = False, progress: ProgressCallback | bool = False) -> SuspectReport:
        """What nodes keep apart that were away while deletions were purged: list it, and put it where nothing lies, or let it go; see `suspects`."""
        return await look_at_suspects(self.access, restore=restore, discard=discard, progress=callback_of(progress))

    async def deciders(self) -> Deciders:
        """Who decides the scene's log."""
        return await deciders_of(self.access)

    async def add_participants(self, entries: Sequence[ParticipantEntry], *, again: Again = None) -> Deciders:
        """Let another node decide, too; an owner's to do. `entries`: of `cluster.membership.participants`, for only trusted nodes may."""
        return await add_participants(self.access, entries, again=again)

    async def remove_participant(self, node: NodeId, *, again: Again = None) -> Deciders:
        """Let a node decide no more; an owner's to do. It takes a majority of those who decide, the node itself counted."""
        return await remove_participant(self.access, node, again=again)

    async def add_observer(self, entry: ParticipantEntry, *, again: Again = None) -> Deciders:
        """Let a node observe the scene; an owner's to do. `entry`: of `cluster.membership.participants`."""
        return await add_observer(self.access, entry, again=again)

    async def remove_observer(self, node: NodeId, *, again: Again = None) -> Deciders:
        """Let a node observe the scene no more; an owner's to do."""
        return await remove_observer(self.access, node, again=again)

    async def render_settings(self) -> SettingsShown:
        """What an image of it is by default, as its log says."""
        return await settings_of(self.access)

    async def change_render_settings(self, change: Callable[[RenderSettings], RenderSettings], *, again: Again = None) -> SettingsShown:
        """Have that changed; an owner's to do, in edit mode. See `change_settings`."""
        return await change_settings(self.access, change, again=again)

    async def end(self, *, dry_run: bool = False, again: Again = None) -> SceneEnd:
        """End this scene, for ever; an owner's to do. `dry_run`: only say what would be lost; see `ending`."""
        return await (plan_end(self.access) if dry_run else end_scene(self.access, again=again))

    async def standing(self, request_id: bytes, offered_at: int = 0) -> Standing:
        """What became of a change of which nobody knew; see `LogAccess.standing`."""
        return await self.access.log_or_fault().standing(request_id, offered_at)

    async def log(self, newest: int | None = None) -> LogStory:
        """What the scene's log says, and who decided it; see `story_of`."""
        return await story_of(self.access, newest)

    async def export(
        self, path: Path | str, progress: ProgressCallback | bool = False, bytes_per_s: float | None = None, *, dry_run: bool = False
    ) -> ExportReport:
        """Write all that lives in this scene, in the clear, to a new file that needs no cluster (specs/24-archive.md): `Scenes.import_archive`
        brings it back. The file is there when all of it is, and not before. `dry_run`: only count.
        """
        return await export_scene(self.access, Path(path), callback_of(progress), bytes_per_s, dry_run=dry_run)

    async def import_file(
        self,
        path: Path | str,
        progress: ProgressCallback | bool = False,
        bytes_per_s: float | None = None,
        *,
        moment: Moment | None = None,
        environment: Path | str | None = None,
    ) -> ImportReport:
        """Read a glTF, GLB, OBJ, PLY or STL file and store it as this scene's content.

        The content becomes visible at once when everything is durable, and not before. An interrupted import is
        repeated by calling this again; what is there already is kept. LocalFault says what is wrong with a file.
        `progress`: a function that is told of every step, or True to have the phases in the log. `bytes_per_s`: of payloads, at most.
        `moment`: of a file that moves; None: at rest. `environment`: a Radiance or OpenEXR image of what lies infinitely far around; None: nothing.
        """
        tell = callback_of(progress)
        prepared = await prepare_import(self.access.calls.world, Path(path), tell, moment, environment)
        return await store_import(self.access, prepared, tell, bytes_per_s)
