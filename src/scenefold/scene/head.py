"""The header that a client held when it asked for a render: no node reads the scene by one that is older, or of another line of keys. Pure.

A node that never met the scene takes the header that others show it. That owners signed it, the genesis tells; that it is not one of
before a revocation, only who has met a newer one. Where the client met the scene in render mode, all nodes of a job hold what they read to
that (specs/26-modes.md, Renders).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.reasons import RejectReason
from scenefold.crypto import PublicKey
from scenefold.scene.log.succession import header_key_now
from scenefold.wire import SceneLogPublic, SceneMode

_KEY_BYTES = 32


@dataclass(frozen=True, slots=True)
class SceneHead:
    """How far the scene was, and the key that signed its header.

    `floor`: in render mode its write floor, above which nobody may have edited; 0: it was in edit mode.
    """

    position: int
    header_key: bytes
    floor: int = 0

    def row(self) -> list[int | bytes]:
        """Plain values."""
        return [self.position, self.header_key, self.floor]

    @classmethod
    def of_row(cls, row: Any) -> SceneHead:
        """What `row` gave; ValueError or TypeError for anything else."""
        position, header_key, floor = row
        if not (_is_position(position) and _is_position(floor) and isinstance(header_key, bytes) and len(header_key) == _KEY_BYTES):
            raise ValueError("two positions and a key are expected")
        return cls(position, header_key, floor)


def _is_position(value: Any) -> bool:
    return type(value) is int and 0 <= value < 1 << 64


NO_HEAD = SceneHead(0, bytes(_KEY_BYTES))
"""Of a scene that is in no cluster."""


def check_head(public: SceneLogPublic, genesis: bytes, head: SceneHead) -> None:
    """DamagedData for the header of another scene or line of keys; Refused (16) for one that is older than the client's, and (9) for one that is
    in render mode no more, if the client's was."""
    where = f"scene {public.scene:08x}"
    if public.genesis != genesis:
        raise DamagedData("the job speaks of another scene with the same id", where=where)
    if public.position < head.position:
        what = f"the scene's header of position {head.position} is not here yet"
        raise Refused(RejectReason.NOT_READY, what, where=where, remedy="render again in a moment")
    if head != NO_HEAD:
        header_key_now(public, PublicKey(head.header_key))
    if head.floor and public.mode is not SceneMode.RENDER:
        raise was_edited(where)


def check_unedited(head: SceneHead, epochs: Iterable[int], where: str) -> None:
    """Refused (9) for records that were written behind the render's beginning: in render mode nobody could. `epochs`: of edits."""
    if head.floor and any(epoch >= head.floor for epoch in epochs):
        raise was_edited(where)


def was_edited(where: str) -> Refused:
    what = "the scene was switched back to edit mode while it was being read for a render"
    return Refused(RejectReason.MODE_FORBIDS, what, where=where, remedy="switch it to render mode, and render again")
