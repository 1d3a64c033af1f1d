"""The scenes of a cluster: made, opened, listed."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from scenefold.base.errors import LocalFault, Refused
from scenefold.base.ids import SceneId
from scenefold.base.reasons import RejectReason
from scenefold.client.access import SceneAccess
from scenefold.client.attendance import chosen
from scenefold.client.births import FIRST_POSITION, born, born_with, first_header, first_private, kept_keys, maker_of
from scenefold.client.calls import Calls
from scenefold.client.copies import BY_DEFAULT, Copies
from scenefold.client.given_scenes import GivenScenes
from scenefold.client.importing import ImportReport, PreparedImport, prepare_import, store_import
from scenefold.client.listed_headers import ListedHeaders
from scenefold.client.patience import is_passing
from scenefold.client.progress import ProgressCallback, callback_of, no_progress
from scenefold.client.restoring import AS_IT_WAS, RestoreOptions, RestoreReport, check_archive, check_new, restore
from scenefold.client.scene import Scene
from scenefold.client.scene_log import LogAccess
from scenefold.client.scene_memory import Met, SceneMemory
from scenefold.client.sealing import SceneIdentity
from scenefold.client.trusted import Wanted
from scenefold.client.verifying import writers_of
from scenefold.crypto import Card, MemberSecrets
from scenefold.scene.log import Decider
from scenefold.wire import ParticipantEntry, SceneLogPublic, SceneMode
from scenefold.world.keyring import KeptScene, Keyring, checked_name
from scenefold.world.log_view import LogView

if TYPE_CHECKING:
    from scenefold.scene.importers import Moment
    from scenefold.scene.payloads.document import SceneDocument

Result = TypeVar("Result")

_SESSION_BYTES = 8
PARTICIPANTS: Wanted | None = None
"""Of a scene whose maker does not say."""


@dataclass(frozen=True, slots=True)
class SceneListing:
    """A scene that the cluster holds; `name` is None if this profile has no keys of it. `granted_by`: of one that was never opened here."""

    id: SceneId
    genesis: bytes
    name: str | None
    granted_by: str | None = None
    is_ended: bool = False

    @property
    def has_key(self) -> bool:
        return self.name is not None

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        return {
            "name": self.name,
            "scene": f"{self.id:08x}",
            "genesis": self.genesis.hex(),
            "has_key": self.has_key,
            "granted_by": self.granted_by,
            "ended": self.is_ended,
        }


class Scenes:
    """`cluster.scenes`."""

    def __init__(
        self,
        calls: Calls,
        keyring: Keyring,
        secrets: MemberSecrets,
        origin: Decider,
        member: str = "user:owner",
        *,
        card_of: Callable[[str], Awaitable[Card]] | None = None,
        cluster_log: Callable[[], Awaitable[LogView]] | None = None,
    ) -> None:
        """`origin`: the node where new scenes begin; always the same, so that a header can be made again.

        `secrets` and `member`: who we are, by our keys and by the name in our certificate. `card_of`: verified cards, by which we
        know who grants us a scene; None: whoever it is, is believed. `cluster_log`: who is trusted to decide; None: nobody but the origin.
        """
        self._cluster_log = cluster_log
        self._calls = calls
        self._origin = origin
        self._keyring = keyring
        self._secrets = secrets
        self._maker = maker_of(member, secrets)
        self._listed = ListedHeaders(calls, origin.node)
        self._gifts = GivenScenes(calls, self._listed, member, secrets, card_of)

    async def create(
        self, name: str, *, copies: int | None = None, copies_min: int | None = None, participants: Wanted | None = PARTICIPANTS
    ) -> Scene:
        """Make an empty scene. Its keys are on disk, durably, before any node hears of it.

        `copies`: how many nodes shall hold each record of the spaces that it begins with, 1 to 8, by default 3; `copies_min`: how many must
        hold it before a write counts as done, by default 2, or `copies` if that is less. `participants`: how many trusted nodes shall decide
        what follows, or which; 0: the cluster's first voter alone; by default up to seven, an odd number, or it alone if fewer than three are trusted.

        If a creation of that name was interrupted, the scene is announced again; LocalFault if it exists already, or was to have other copies.
        """
        checked_name(name, "scene")
        deciding = await self._deciding(name, participants)
        wanted = Copies.checked(f"scene {name}", BY_DEFAULT.copies if copies is None else copies, copies_min)
        kept = await self._kept(name)
        if kept is not None:
            log = await self._log(kept)
            header = await log.header()
            if header is not None and header.mode is SceneMode.ENDED:
                what = f"this profile had a scene {name!r}, which was ended, and keeps its keys"
                raise LocalFault(what, where=f"id {kept.scene_id:08x}", remedy="choose another name")
            if header is not None:
                what, where = f"a scene {name!r} exists already", f"id {kept.scene_id:08x}"
                raise LocalFault(what, where=where, remedy="choose another name, or open it")
            before = born_with(log.keys, self._maker, self._origin)
            if before is not None and before != wanted and (copies, copies_min) != (None, None):
                what = f"a creation of the scene {name!r} with {before.copies} copies, {before.least} of them needed, was interrupted"
                raise LocalFault(what, where=f"id {kept.scene_id:08x}", remedy="say so again, or choose another name")
            return await self._announce(kept, log, deciding)
        kept = born(name, self._maker, self._secrets.signing, self._origin, self._calls.world.entropy.token, wanted)
        await self._on_disk(self._keyring.save, kept)
        return await self._announce(kept, await self._log(kept), deciding, is_new=True)

    async def open(self, name: str) -> Scene:
        """The scene of this name in the profile's keyring, or one that somebody has granted; LocalFault if there is none.

        One that was granted may be named by its id as well. It is kept in the keyring from then on: the name will mean this one.
        """
        checked_name(name, "scene")
        kept = await self._kept(name) or await self._granted(name)
        if kept is None:
            kept = await self._on_disk(self._keyring.load, name)  # says what there is
        log = await self._log(kept)
        header = await log.header()
        if header is None:
            remedy = f"`scenectl scene create {name}` announces it again"
            raise LocalFault("the cluster does not know this scene", where=f"scene {name}", remedy=remedy)
        return self._scene(log, header)

    async def open_or_create(self, name: str, *, copies: int | None = None, copies_min: int | None = None) -> Scene:
        """Open the scene of this name in the profile's keyring, or make it, with so many copies (`create`), if there is none.

        LocalFault if somebody has granted one of this name that was never opened here: what is to be written into a scene of one's own must
        not land in a scene of whoever was quicker to use its name.
        """
        checked_name(name, "scene")
        kept = await self._kept(name)
        if kept is None:
            gifts = await self._gifts.named(name)
            if gifts:
                givers = ", ".join(f"{gift.contents.granter} (id {gift.header.scene:08x})" for gift in gifts)
                remedy = f"`scenectl scene info {name}` takes it, if you mean that one; else choose another name"
                raise LocalFault(
                    f"a scene {name!r} was granted to you, and you have not opened it yet", where=f"by {givers}", remedy=remedy
                )
        else:
            log = await self._log(kept)
            header = await log.header()
            if header is not None:
                return self._scene(log, header)
            return await self._announce(kept, log, await self._deciding(name, PARTICIPANTS))
        return await self.create(name, copies=copies, copies_min=copies_min)

    async def import_file(
        self,
        name: str,
        path: Path | str,
        progress: ProgressCallback | bool = False,
        bytes_per_s: float | None = None,
        *,
        environment: Path | str | None = None,
        replacing: Callable[[SceneDocument], None] | None = None,
        moment: Moment | None = None,
    ) -> tuple[Scene, ImportReport]:
        """Import a file into the scene of this name, made if there is none once the file is known to be good.

        See `Scene.import_file`. `environment`: image file of what lies infinitely far around. `replacing`: told of what the scene shows, if anything, before that is replaced.
        """
        checked_name(name, "scene")
        tell = callback_of(progress)
        prepared = await prepare_import(self._calls.world, Path(path), tell, moment, environment)
        return await self.import_prepared(name, prepared, tell, bytes_per_s, replacing=replacing)

    async def import_prepared(
        self,
        name: str,
        prepared: PreparedImport,
        progress: ProgressCallback = no_progress,
        bytes_per_s: float | None = None,
        *,
        replacing: Callable[[SceneDocument], None] | None = None,
    ) -> tuple[Scene, ImportReport]:
        """The second half of `import_file`, for a file that was read before there was a cluster."""
        scene = await self.open_or_create(name)
        return scene, await store_import(scene.access, prepared, progress, bytes_per_s, replacing)

    async def import_archive(self, name: str, path: Path | str, options: RestoreOptions = AS_IT_WAS) -> tuple[Scene, RestoreReport]:
        """Bring what `Scene.export` has written into a new scene of this name, made once the file is known to be good; see `restoring`."""
        checked = await check_archive(self._calls.world, Path(path), options)
        check_new(checked_name(name, "scene"), await self.kept_names(), options)
        copies, least = checked.born_with
        scene = await self.open_or_create(name, copies=copies, copies_min=least)
        return scene, await restore(scene.access, checked, options)

    async def list(self, *, ended: bool = False) -> list[SceneListing]:
        """All scenes of the cluster, those with keys here first, by name: in the keyring, or in the header's lockbox for us.

        `ended`: also those that were ended.
        """
        headers = [header for header in await self.headers() if ended or header.mode is not SceneMode.ENDED]
        names = await self._on_disk(_names_by_genesis, self._keyring)
        given = await self._gifts.among([header for header in headers if header.genesis not in names])
        found = []
        for header in headers:
            gift = given.get(header.genesis)
            name = names.get(header.genesis) or (None if gift is None else gift.contents.name)
            granter, is_ended = None if gift is None else gift.contents.granter, header.mode is SceneMode.ENDED
            found.append(SceneListing(header.scene, header.genesis, name, granter, is_ended))
        return sorted(found, key=lambda scene: (scene.name is None, scene.name or "", scene.genesis))

    async def headers(self) -> Sequence[SceneLogPublic]:
        """The headers of all scenes of the cluster that prove themselves, by the word of a few nodes, where new scenes of this profile begin among them."""
        return await self._listed.of_some()

    async def kept_names(self) -> Sequence[str]:
        """The scenes that this profile has keys of."""
        return await self._on_disk(self._keyring.names)

    async def _on_disk(self, function: Callable[..., Result], *arguments: object) -> Result:
        return await self._calls.world.workers.run("import", function, *arguments)

    async def _kept(self, name: str) -> KeptScene | None:
        """The entry of a scene if this profile has any."""
        names = await self._on_disk(self._keyring.names)
        return await self._on_disk(self._keyring.load, name) if name in names else None

    async def _granted(self, name: str) -> KeptScene | None:
        """The entry of a scene that was granted to us under this name or id, kept from now on; None if there is none."""
        fitting = await self._gifts.named(name)
        if len(fitting) > 1:
            ids = ", ".join(f"{gift.header.scene:08x}" for gift in fitting)
            raise LocalFault(f"several scenes {name!r} were granted to you", where=f"ids {ids}", remedy="give the id in place of the name")
        if not fitting:
            return None
        header, lockbox, contents = fitting[0]
        kept = KeptScene(
            name, header.genesis, contents.header_key.key_id, header.key_epoch, lockbox, header.position, Met.by(header).header_hash
        )
        await self._on_disk(self._keyring.save, kept)
        return kept

    async def _deciding(self, name: str, wanted: Wanted | None) -> tuple[ParticipantEntry, ...]:
        """Who shall decide: who answers before who does not, where a number was given. Refused (15) if too few of them do."""
        if wanted == 0:
            return ()
        view = LogView() if self._cluster_log is None else await self._cluster_log()
        return await chosen(self._calls, view, wanted, self._origin.node, name)

    async def _announce(self, kept: KeptScene, log: LogAccess, deciding: Sequence[ParticipantEntry], *, is_new: bool = False) -> Scene:
        """Propose the first header; any node hands it on to the one that decides. Proposing it again is harmless."""
        if kept.position > FIRST_POSITION:
            remedy = "start all nodes of the cluster; one of them had it"
            raise LocalFault("the cluster does not know this scene any more", where=f"scene {kept.name}", remedy=remedy)
        header = first_header(kept, log.keys, self._maker, self._origin, deciding)
        if header is None:
            what = "the scene was made by another user or for other nodes"
            raise LocalFault(what, where=f"scene {kept.name}", remedy="use the profile that made it")
        try:
            header = await log.announce(header, first_private(log.keys, self._maker, self._origin, deciding))
        except Refused as refusal:
            if refusal.reason is RejectReason.POSITION_TAKEN and (found := await log.header()) is not None:
                # It was made before, and nobody knew: with others to decide, which the genesis does not cover.
                return self._scene(log, found)
            if is_new and not is_passing(refusal.reason):
                # The cluster has no such scene and will not have it, so its keys open nothing. Of doubt we hear as Unreachable.
                await self._on_disk(self._keyring.remove, kept.name)
            raise
        return self._scene(log, header)

    def _scene(self, log: LogAccess, header: SceneLogPublic) -> Scene:
        keys = log.keys
        identity = SceneIdentity(keys.scene_id, keys.genesis, header.position, writers_of(header), keys.epochs).with_header(header)
        session = int.from_bytes(self._calls.world.entropy.token(_SESSION_BYTES), "big")
        return Scene(SceneAccess(self._calls, keys.name, identity, self._secrets.signing, session, log=log))

    async def _log(self, kept: KeptScene) -> LogAccess:
        keys = await self._calls.world.workers.run("crypto", kept_keys, kept, self._secrets.sealing)

        async def write(newer: KeptScene) -> None:
            await self._on_disk(self._keyring.advance, newer)

        return LogAccess(self._calls, keys, self._secrets, SceneMemory.of(kept, write))


def _names_by_genesis(keyring: Keyring) -> dict[bytes, str]:
    return {kept.genesis: kept.name for kept in map(keyring.load, keyring.names())}
