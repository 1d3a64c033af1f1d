"""How every scene's log begins: one record that creates the spaces of scenefold.scene.layout, and names the maker as owner.

Its bytes follow from the scene's genesis and its maker, so that a creation that was interrupted can announce the very same record again.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

from scenefold.base.ids import SPACE_ID_MAX, NodeId, SpaceId
from scenefold.base.limits import COPIES_DEFAULT, COPIES_MIN_DEFAULT
from scenefold.base.location import FIRST
from scenefold.scene.layout import SPACES, SpaceLayout
from scenefold.scene.log.book import SceneLog
from scenefold.scene.log.new_shadows import shadows_of
from scenefold.scene.log.shadows import free_offsets
from scenefold.wire import AddParticipant, Batch, CreateSpace, CurveKind, Grant, LogRecord, ParticipantEntry

_REQUEST_ID_BYTES = 16


def first_entry(
    maker: Grant, copies: int = COPIES_DEFAULT, least: int = COPIES_MIN_DEFAULT, participants: Sequence[ParticipantEntry] = ()
) -> Batch:
    """The spaces of a new scene, each with so many copies, of which `least` (no more than that) must be there, the shadows for these, those who
    decide from the next position on, and its first owner."""
    spaces = [_created(space, copies, min(least, copies)) for space in SPACES]
    names = {space.name for space in SPACES}
    ids = (SpaceId(number) for number in range(len(SPACES) + 1, SPACE_ID_MAX + 1))
    shadows = [shadow for space in spaces for shadow in shadows_of(space, free_offsets((), copies - 1), ids, names)]
    deciding = (AddParticipant(entry.member, entry.key) for entry in participants)
    return Batch((*spaces, *shadows, *deciding, maker))


def first_record(
    genesis: bytes,
    origin: NodeId,
    maker: Grant,
    copies: int = COPIES_DEFAULT,
    least: int = COPIES_MIN_DEFAULT,
    participants: Sequence[ParticipantEntry] = (),
) -> LogRecord:
    """The record at position 1."""
    request_id = hashlib.sha256(b"scenefold/first-record" + genesis).digest()[:_REQUEST_ID_BYTES]
    return SceneLog().next_record(first_entry(maker, copies, least, participants), request_id, origin)


def first_log(
    genesis: bytes,
    origin: NodeId,
    maker: Grant,
    copies: int = COPIES_DEFAULT,
    least: int = COPIES_MIN_DEFAULT,
    participants: Sequence[ParticipantEntry] = (),
) -> SceneLog:
    """The state after it."""
    return SceneLog().apply(first_record(genesis, origin, maker, copies, least, participants))


def _created(space: SpaceLayout, copies: int, least: int) -> CreateSpace:
    return CreateSpace(
        space=space.id,
        dimensions=space.dimensions,
        curve=CurveKind.Z_ORDER if space.curve == "z-order" else CurveKind.HILBERT,
        node_managed=space.node_managed,
        parent=SpaceId(0),
        offset=FIRST,
        copies=copies,
        copies_min=least,
        render_output=space.render_output,
        name=space.name,
        low=(0.0,) * space.dimensions,
        high=(1.0,) * space.dimensions,
    )
