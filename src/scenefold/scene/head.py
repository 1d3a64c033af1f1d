"""The header that a client held when it asked for a render: no node reads the scene by one that is older, or of another line of keys. Pure.

A node that never met the scene takes the header that others show it. That owners signed it, the genesis tells; that it is not one of
before a revocation, only who has met a newer one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.reasons import RejectReason
from scenefold.crypto import PublicKey
from scenefold.scene.log.succession import header_key_now
from scenefold.wire import SceneLogPublic

_KEY_BYTES = 32


@dataclass(frozen=True, slots=True)
class SceneHead:
    """How far the scene was, and the key that signed its header."""

    position: int
    header_key: bytes

    def row(self) -> list[int | bytes]:
        """Plain values."""
        return [self.position, self.header_key]

    @classmethod
    def of_row(cls, row: Any) -> SceneHead:
        """What `row` gave; ValueError or TypeError for anything else."""
        position, header_key = row
        if type(position) is not int or not 0 <= position < 1 << 64 or not isinstance(header_key, bytes) or len(header_key) != _KEY_BYTES:
            raise ValueError("a position and a key are expected")
        return cls(position, header_key)


NO_HEAD = SceneHead(0, bytes(_KEY_BYTES))
"""Of a scene that is in no cluster."""


def check_head(public: SceneLogPublic, genesis: bytes, head: SceneHead) -> None:
    """DamagedData for the header of another scene or line of keys; Refused (16) for one that is older than the client's."""
    where = f"scene {public.scene:08x}"
    if public.genesis != genesis:
        raise DamagedData("the job speaks of another scene with the same id", where=where)
    if public.position < head.position:
        what = f"the scene's header of position {head.position} is not here yet"
        raise Refused(RejectReason.NOT_READY, what, where=where, remedy="render again in a moment")
    if head != NO_HEAD:
        header_key_now(public, PublicKey(head.header_key))
