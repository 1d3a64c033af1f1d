"""The scenes' headers that a folder holds, and what they say of its records (specs/21-verify.md). Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from scenefold.base.errors import Refused
from scenefold.base.ids import SceneId
from scenefold.base.reasons import RejectReason
from scenefold.crypto import Record
from scenefold.peer.records.verification import KnownScene, verify_copies
from scenefold.peer.scene_log.headers import checked_header
from scenefold.store import Spot
from scenefold.store.checking import EVERY_KEY, Finding, Helps
from scenefold.store.layout import HEADERS, NOTES, scene_of
from scenefold.wire import HandItem, MalformedPacket, SceneLogPublic
from scenefold.world import ReadTransaction

SCENE_LOG = "scene-log/"
_SCENE_BYTES = 4


class Scenes:
    """Those whose headers verify. Judges records (port `Judge` of a look at a store)."""

    def __init__(self, known: Mapping[SceneId, KnownScene]) -> None:
        self._known = known

    def __call__(self, spot: Spot, record: Record, /) -> str | None:
        scene = self._known.get(spot.place.scene)
        if scene is None:
            return ""
        place = spot.place
        item = HandItem(place.scene, place.space, place.location, spot.object, record.signature, record.header_bytes, record.ciphertext)
        (verdict,) = verify_copies([(item, scene)])
        if not isinstance(verdict, Refused):
            return None
        # Of all else a later header may say something else: of a writer, a space, an epoch.
        return "the record there is not signed by its writer" if verdict.reason is RejectReason.SIGNATURE_INVALID else ""


def known_scenes(view: ReadTransaction) -> tuple[Scenes, list[Finding]]:
    """The scenes of a store, and what is wrong with their headers."""
    known, wrong = dict[SceneId, KnownScene](), list[Finding]()
    for key, value in view.scan(HEADERS, *EVERY_KEY):
        problem = "a header under a key that is no scene's"
        if len(key) == _SCENE_BYTES:
            try:
                scene = checked_header(SceneLogPublic.decode(bytes(value)), None)
            except (MalformedPacket, Refused) as refusal:
                problem = f"the scene's header does not verify: {refusal}"
            else:
                if scene.public.scene == scene_of(key):
                    known[scene_of(key)] = scene
                    continue
                problem = "the header there is that of another scene"
        wrong += _wrong(view, key, problem)
    return Scenes(known), wrong


def _wrong(view: ReadTransaction, key: bytes, problem: str) -> Iterator[Finding]:
    where = f"scene {key.hex()}"
    # Who keeps a scene's log must not forget how far it is.
    is_kept = view.get(NOTES, f"{SCENE_LOG}{key.hex()}".encode()) is not None
    yield Finding(HEADERS, where, problem, Helps.WIPE if is_kept else Helps.FETCH)
