"""How often the log of a scene may go on: each change is sent whole, kept durably, and told to all members (specs/16-scene-log.md). Pure.

Who may decide a change is an owner of the scene, and nothing else holds it back. It is counted by scene, and for all scenes of one maker
together, since one user may make many. Owners of a few of these can use up what is the maker's, and do so again whenever some of it comes
back; so each scene has a little of its own beyond that, which nobody takes who is no owner of it.

An owner who means harm can use up all of that for one scene. What puts an end to it, that another owner revokes this one, is never held back,
and needs no bound: the header lists all keys that it was ever signed with, so a scene has few such changes in its whole life. For changes
that revoke anybody else a part is set aside.
"""

from __future__ import annotations

from scenefold.base.errors import Refused
from scenefold.base.limits import SCENES_PER_USER_MAX
from scenefold.base.reasons import RejectReason
from scenefold.peer.records.verification import KnownScene
from scenefold.peer.scene_log.makers import maker_of
from scenefold.wire import SceneLogPublic
from scenefold.world.buckets import Buckets

OF_SCENE_BURST = 128
"""A program that builds a scene makes its spaces and grants one after the other."""
OF_SCENE_PER_S = 2.0
OF_MAKER_BURST = 512
OF_MAKER_PER_S = 8.0
"""Of all scenes of one maker."""
OWN_BURST = 4
OWN_PER_S = OF_MAKER_PER_S / SCENES_PER_USER_MAX
"""Of each scene, when those of its maker are used up: one in 16 s, which a client waits for. Those of all scenes that a maker can have are as
many as the maker's."""
KEYS_BURST = 4
KEYS_PER_S = OWN_PER_S
"""Of each scene, for new key epochs alone, when everything else is used up."""


class Changes:
    """Those that this node has decided since its start."""

    def __init__(self) -> None:
        self._of_scene = Buckets(OF_SCENE_BURST, OF_SCENE_PER_S)
        self._of_maker = Buckets(OF_MAKER_BURST, OF_MAKER_PER_S)
        self._own = Buckets(OWN_BURST, OWN_PER_S)
        self._keys = Buckets(KEYS_BURST, KEYS_PER_S)

    def check(self, scene: KnownScene, public: SceneLogPublic, now: float) -> None:
        """Refused (13) if this would be the scene's next header, and it has to wait. Nothing of it was verified yet."""
        if public.position != scene.public.position + 1 or self._paid_from(scene, public, now) is not None:
            # If it is not the next one, it is refused for what it is, and may have been decided.
            return
        which = f"scene {scene.public.scene:08x} was"
        if self._of_scene.has(_name_of(scene), now):
            which = f"the scenes of the maker of {scene.public.scene:08x} were"
        raise Refused(RejectReason.BUSY, f"{which} changed too often lately", remedy="try again in a while")

    def count(self, scene: KnownScene, public: SceneLogPublic, now: float) -> None:
        """It was decided: what is refused costs nothing, so that whoever waits may ask as often as it likes."""
        for buckets, name in self._paid_from(scene, public, now) or ():
            buckets.take(name, now)

    def _paid_from(self, scene: KnownScene, public: SceneLogPublic, now: float) -> tuple[tuple[Buckets, str], ...] | None:
        """The buckets that the next header of a scene takes one from each; None if they do not have it."""
        name, maker = _name_of(scene), _name_of_maker(scene)
        if len(public.succession) > len(scene.public.succession):
            return ()
        if self._of_scene.has(name, now):
            if self._of_maker.has(maker, now):
                return (self._of_scene, name), (self._of_maker, maker)
            if self._own.has(name, now):
                return (self._of_scene, name), (self._own, name)
        if public.key_epoch > scene.public.key_epoch and self._keys.has(name, now):
            return ((self._keys, name),)
        return None


def _name_of(scene: KnownScene) -> str:
    return str(scene.public.scene)


def _name_of_maker(scene: KnownScene) -> str:
    maker = maker_of(scene)
    return "" if maker is None else maker.raw.hex()
