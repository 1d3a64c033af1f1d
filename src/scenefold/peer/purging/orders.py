"""May these records be purged? (specs/22-purge.md, Orders.) Pure; runs in the crypto lane.

Whoever is asked looks at the order itself: what a node marks, and drops, no other node's word is enough for.
"""

from __future__ import annotations

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.ids import SceneId
from scenefold.base.reasons import RejectReason
from scenefold.crypto import PURGE_DOMAIN, RecordPlace
from scenefold.peer.records.verification import KnownScene
from scenefold.store import Spot
from scenefold.wire import PurgeItem, PurgeOrder

_FOR_EVER = 2**64 - 1


def check_order(order: PurgeOrder, scene: KnownScene) -> None:
    """Refused unless a present writer of the scene has signed it, and all that it names was signed before the scene's newest purge began."""
    public = scene.public
    if public.position < order.position:
        raise Refused(RejectReason.NOT_READY, f"the scene's header of position {order.position} is not here yet")
    terms = scene.writers.get(order.writer, ())
    key = scene.keys.get(order.writer)
    if key is None or not terms:
        raise Refused(RejectReason.NOT_AUTHORISED, f"key {order.writer:08x} is no writer of the scene")
    if all(term.until_position != _FOR_EVER for term in terms):
        raise Refused(RejectReason.KEY_REVOKED, f"key {order.writer:08x} is no writer of the scene any more")
    for item in order.items:
        if item.space not in scene.spaces:
            raise Refused(RejectReason.UNKNOWN_SCENE_OR_SPACE, f"the scene has no space {item.space}")
        scene.check_no_shadow(item.space, "purge")
        if item.object and item.space not in scene.managed:
            raise Refused(RejectReason.ILL_FORMED, f"there are no objects in space {item.space}: places are the writers' choice there")
        if item.version.epoch >= public.purged:
            what = f"no purge has begun since position {item.version.epoch}, at which a record was written"
            raise Refused(RejectReason.ILL_FORMED, what, remedy="let an owner of the scene begin one")
    try:
        key.verify(order.signature, PURGE_DOMAIN, order.signable(public.genesis))
    except DamagedData as problem:
        raise Refused(RejectReason.SIGNATURE_INVALID, str(problem)) from problem


def spot_in(scene: SceneId, item: PurgeItem) -> Spot:
    return Spot(RecordPlace(scene, item.space, item.location), item.object)
