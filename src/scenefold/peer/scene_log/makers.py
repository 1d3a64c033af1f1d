"""Who made a scene, and may that one make another? (specs/16-scene-log.md, Deciding.) Pure.

All scenes begin at the cluster's first voter, so a header that names another one as who decides is taken by nobody that meets its scene for
the first time: a member that decides scenes itself could search for the id of another one, and shut that out wherever its own is met first.

The maker is the first writer of every header, and has signed the lockbox of the first one, so nobody makes a scene at the cost of
another. The first voter takes so many scenes of each user, and no more: else one alone could fill the list of all nodes.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.ids import NodeId, SceneId
from scenefold.base.limits import ENDED_PER_USER_MAX, SCENES_KEPT_MAX, SCENES_LISTED_MAX, SCENES_PER_USER_MAX
from scenefold.base.reasons import RejectReason
from scenefold.crypto import PublicKey
from scenefold.peer.records.verification import KnownScene
from scenefold.scene.log.lockboxes import check_sealed_by
from scenefold.scene.log.values import deciding
from scenefold.wire import SceneLogPublic
from scenefold.world.facts import Credential


def check_decider(public: SceneLogPublic, voter: Credential | None) -> None:
    """Refused unless the scene, which is unknown here, is one that the cluster's first voter decides. Its key in the header is whole, no id
    that can be searched for, and genesis is a hash of it; so the other scene of a 32-bit id would have to be decided by the voter, too."""
    if voter is None or (public.origin, public.origin_key) != (voter.node_id, voter.public_key.raw):
        raise Refused(RejectReason.NOT_AUTHORISED, "the scene was not begun at the cluster's first voter")


def maker_of(scene: KnownScene) -> PublicKey | None:
    """The key of the scene's maker; None for a header without writers."""
    writers = scene.public.writers
    return scene.keys.get(writers[0].key) if writers else None


def check_room(known: Collection[KnownScene], *, is_ended: bool = False) -> None:
    """Refused if there are so many scenes already. `is_ended`: for one that takes no room but that of its header."""
    if len(known) >= SCENES_KEPT_MAX:
        what = f"this cluster holds {SCENES_KEPT_MAX} scenes already, with those that were ended"
        raise Refused(RejectReason.LIMIT_EXCEEDED, what)
    if not is_ended and sum(not one.is_ended for one in known) >= SCENES_LISTED_MAX:
        raise Refused(RejectReason.LIMIT_EXCEEDED, f"this cluster holds {SCENES_LISTED_MAX} scenes already")


def begun_by(node: NodeId, key: PublicKey, known: Iterable[KnownScene]) -> list[KnownScene]:
    """The scenes whose maker that node has looked at. Who decides elsewhere can name any user in its headers."""
    return [one for one in known if one.public.origin == node and one.public.origin_key == key.raw]


def relying_on(node: NodeId, known: Iterable[KnownScene]) -> list[SceneId]:
    """The scenes whose log that node decides, alone or with others, by id. Of those that were ended nobody decides anything."""
    return sorted(one.public.scene for one in known if node in deciding(one.public) and not one.is_ended)


def check_maker(scene: KnownScene, decided_here: Iterable[KnownScene], may_make: Callable[[PublicKey], bool]) -> None:
    """Refused unless the scene with this first header was made by one who may: a user (`may_make`) who has not made too many."""
    maker, public = maker_of(scene), scene.public
    if maker is None or len(public.lockboxes) != 1:
        raise Refused(RejectReason.ILL_FORMED, "the first header of a scene names its maker, and holds the maker's lockbox")
    try:
        check_sealed_by(public.lockboxes[0], public.genesis, public.key_epoch, public.first_key, maker)
    except DamagedData as problem:
        raise Refused(RejectReason.SIGNATURE_INVALID, f"the maker of the scene has not signed: {problem}") from problem
    if not may_make(maker):
        raise Refused(RejectReason.NOT_AUTHORISED, f"the scene's maker, key {maker.key_id:08x}, is no user of this cluster")
    ended = [other.is_ended for other in decided_here if maker_of(other) == maker]
    if ended.count(False) >= SCENES_PER_USER_MAX:
        raise Refused(RejectReason.LIMIT_EXCEEDED, f"key {maker.key_id:08x} has made {SCENES_PER_USER_MAX} scenes already")
    if ended.count(True) >= ENDED_PER_USER_MAX:
        raise Refused(RejectReason.LIMIT_EXCEEDED, f"key {maker.key_id:08x} has made and ended {ENDED_PER_USER_MAX} scenes already")
