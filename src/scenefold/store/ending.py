"""A scene that was ended: all of it goes, but for its header (specs/16-scene-log.md, The end)."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice

from scenefold.base.errors import Refused
from scenefold.base.ids import SceneId
from scenefold.base.reasons import RejectReason
from scenefold.store.bygone import Bygone
from scenefold.store.changes import MayUseReserve, PutValue, PutValues, storage_full
from scenefold.store.keeping import drop_record
from scenefold.store.layout import LOGS, NOTES, RECORDS, SUSPECTS, Spot, log_note, scene_key, spot_of
from scenefold.store.log_rows import POSITION_MAX, decided_key, votes_key
from scenefold.store.noticing import Noticed
from scenefold.store.opened import OpenedStore
from scenefold.store.reading import read_value
from scenefold.store.tally import Tally
from scenefold.world.ports import ReadTransaction, WriteTransaction

BATCH_RECORDS = 256
"""That go in one commit."""
_OF_SCENE_END = b"\xff" * 64
_FRAMING_BYTES = 512


def let_go_note(scene: SceneId) -> bytes:
    """The name of the note that says that nothing of a scene is kept or shown here any more."""
    return b"let-go/%08x" % scene


@dataclass(frozen=True, slots=True)
class DropScene(MayUseReserve):
    """Delete the first records of a scene, rotten ones among them, and of those that are set aside. Gives where they lay."""

    scene: SceneId

    @property
    def size_bytes(self) -> int:
        return BATCH_RECORDS * _FRAMING_BYTES

    def apply(self, transaction: WriteTransaction, tally: Tally, /) -> list[Spot]:
        first, last = _keys_of(self.scene)
        gone = [spot_of(key) for key in islice(transaction.keys(RECORDS, first, last), BATCH_RECORDS)]
        for spot in gone:
            drop_record(transaction, tally, spot)
        aside = list(islice(transaction.keys(SUSPECTS, first, last), BATCH_RECORDS - len(gone)))
        for key in aside:
            transaction.delete(SUSPECTS, key)
        return gone + [spot_of(key) for key in aside]

    def when_full(self, _transaction: ReadTransaction, /) -> list[Spot]:
        raise storage_full()


@dataclass(frozen=True, slots=True)
class DropSceneLog(MayUseReserve):
    """Delete a scene's sealed log, and all that was voted for and decided of it."""

    scene: SceneId
    genesis: bytes

    @property
    def size_bytes(self) -> int:
        return _FRAMING_BYTES

    def apply(self, transaction: WriteTransaction, _tally: Tally, /) -> None:
        for table, key in _rows_of_log(transaction, self.scene, self.genesis):
            transaction.delete(table, key)

    def when_full(self, _transaction: ReadTransaction, /) -> None:
        raise storage_full()


class EndingStore(OpenedStore):
    """The part of the store that lets go of scenes."""

    bygone: Bygone
    noticed: Noticed

    def has_let_go(self, scene: SceneId) -> bool:
        """Whether nothing of the scene is kept or shown here any more; what is left of it on the disk goes."""
        return scene in self.bygone.ended

    def check_kept(self, scene: SceneId) -> None:
        """Refused (9) for a scene that this node has let go of: that nothing lies there would be no answer."""
        if self.has_let_go(scene):
            what = f"scene {scene:08x} was ended, and nodes have let go of what it held"
            raise Refused(RejectReason.MODE_FORBIDS, what, remedy="use another scene")

    async def recall_let_go(self, scene: SceneId) -> bool:
        """Whether an earlier life let go of it; then this one has, too."""
        if await self._view(read_value, NOTES, let_go_note(scene)) is None:
            return False
        self.bygone.ended.add(scene)
        return True

    async def let_go(self, scene: SceneId) -> None:
        """Take and show nothing more of a scene, for ever: at once, and durably on return. Refused if the disk is full."""
        self.bygone.ended.add(scene)
        await self._writer.submit(PutValues((PutValue(NOTES, let_go_note(scene), b"\1"),)))

    async def drop_scene(self, scene: SceneId) -> int:
        """Delete some of the records of a scene that was let go of; gives how many: 0 once none is left."""
        gone = await self._writer.submit(DropScene(scene))
        self.noticed.gone(gone)
        return len(gone)

    async def drop_scene_log(self, scene: SceneId, genesis: bytes) -> None:
        """Likewise its sealed log, and what this node has voted for in it."""
        await self._writer.submit(DropSceneLog(scene, genesis))

    async def keeps_of(self, scene: SceneId, genesis: bytes) -> bool:
        """Whether there is anything on the disk that these would delete."""
        return await self._view(_keeps_of, scene, genesis)


def _keeps_of(transaction: ReadTransaction, scene: SceneId, genesis: bytes) -> bool:
    first, last = _keys_of(scene)
    lies_there = any(next(iter(transaction.keys(table, first, last)), None) is not None for table in (RECORDS, SUSPECTS))
    return lies_there or bool(_rows_of_log(transaction, scene, genesis))


def _keys_of(scene: SceneId) -> tuple[bytes, bytes]:
    return scene_key(scene), scene_key(scene) + _OF_SCENE_END


def _rows_of_log(transaction: ReadTransaction, scene: SceneId, genesis: bytes) -> list[tuple[str, bytes]]:
    found = [(NOTES, log_note(scene)), (LOGS, votes_key(genesis))]
    found += [(LOGS, key) for key in transaction.keys(LOGS, decided_key(genesis, 0), decided_key(genesis, POSITION_MAX))]
    return [(table, key) for table, key in found if transaction.get(table, key) is not None]
