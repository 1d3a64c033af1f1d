"""How every scene's log begins: one record that creates the spaces of scenefold.scene.layout, and names the maker as owner.

Its bytes follow from the scene's genesis and its maker, so that a creation that was interrupted can announce the very same record again.
"""

from __future__ import annotations

import hashlib

from scenefold.base.ids import NodeId, SpaceId
from scenefold.base.location import FIRST
from scenefold.scene.layout import SPACES, SpaceLayout
from scenefold.scene.log.book import SceneLog
from scenefold.wire import Batch, CreateSpace, CurveKind, Grant, LogRecord

_REQUEST_ID_BYTES = 16


def first_entry(maker: Grant) -> Batch:
    """The spaces of a new scene, and its first owner."""
    return Batch((*map(_created, SPACES), maker))


def first_record(genesis: bytes, origin: NodeId, maker: Grant) -> LogRecord:
    """The record at position 1."""
    request_id = hashlib.sha256(b"scenefold/first-record" + genesis).digest()[:_REQUEST_ID_BYTES]
    return SceneLog().next_record(first_entry(maker), request_id, origin)


def first_log(genesis: bytes, origin: NodeId, maker: Grant) -> SceneLog:
    """The state after it."""
    return SceneLog().apply(first_record(genesis, origin, maker))


def _created(space: SpaceLayout) -> CreateSpace:
    return CreateSpace(
        space=space.id,
        dimensions=space.dimensions,
        curve=CurveKind.Z_ORDER if space.curve == "z-order" else CurveKind.HILBERT,
        node_managed=space.node_managed,
        parent=SpaceId(0),
        offset=FIRST,
        copies=1,
        copies_min=1,
        render_output=space.render_output,
        name=space.name,
        low=(0.0,) * space.dimensions,
        high=(1.0,) * space.dimensions,
    )
