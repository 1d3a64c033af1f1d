"""How often the log of a scene may go on: each change is sent whole, kept durably, and told to all members (specs/16-scene-log.md). Pure.

Who may decide a change is an owner of the scene, and nothing else holds it back. It is counted by scene, so that an owner of one takes
nothing from others, and for all scenes of one maker together, since one user may make many.
"""

from __future__ import annotations

from scenefold.base.errors import Refused
from scenefold.base.reasons import RejectReason
from scenefold.peer.records.verification import KnownScene
from scenefold.peer.scene_log.makers import maker_of
from scenefold.world.buckets import Buckets

OF_SCENE_BURST = 128
"""A program that builds a scene makes its spaces and grants one after the other."""
OF_SCENE_PER_S = 2.0
"""Less than a client's pauses between tries, so that one who is patient comes in."""
OF_MAKER_BURST = 512
OF_MAKER_PER_S = 8.0
"""Of all scenes of one maker."""


class Changes:
    """Those that this node has decided since its start."""

    def __init__(self) -> None:
        self._of_scene = Buckets(OF_SCENE_BURST, OF_SCENE_PER_S)
        self._of_maker = Buckets(OF_MAKER_BURST, OF_MAKER_PER_S)

    def check(self, scene: KnownScene, position: int, now: float) -> None:
        """Refused (13) if this would be the scene's next position, and it has to wait."""
        if position != scene.public.position + 1:
            # Not the next one: it is refused for what it is, and may have been decided.
            return
        if not self._of_scene.has(str(scene.public.scene), now):
            raise Refused(RejectReason.BUSY, f"scene {scene.public.scene:08x} was changed too often lately", remedy="try again in a while")
        if not self._of_maker.has(_name_of_maker(scene), now):
            what = f"the scenes of the maker of {scene.public.scene:08x} were changed too often lately"
            raise Refused(RejectReason.BUSY, what, remedy="try again in a while")

    def count(self, scene: KnownScene, now: float) -> None:
        """It was decided: what is refused costs nothing, so that whoever waits may ask as often as it likes."""
        self._of_scene.take(str(scene.public.scene), now)
        self._of_maker.take(_name_of_maker(scene), now)


def _name_of_maker(scene: KnownScene) -> str:
    maker = maker_of(scene)
    return "" if maker is None else maker.raw.hex()
