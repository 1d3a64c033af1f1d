"""Packets 121 and 122: what a client asks of the leases of a scene's participants (specs/26-modes.md, Lent leases)."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import ClassVar

from scenefold.base.ids import KeyId
from scenefold.wire.common import BOOL, DIGEST, INCARNATION, SCENE, U32, U64, Carrier, NodeId, Packet, SceneId, row
from scenefold.wire.kinds import Bin, Choice
from scenefold.wire.scene_headers import SceneMode

_SIGNATURE = Bin(lengths=(0, 64, 384))
_ANYBODY = NodeId(0)
_NO_KEY = KeyId(0)


class LeaseUse(IntEnum):
    """What a client wants: to know the mode, to edit, to render, or nothing any more."""

    LOOK = 1
    EDIT = 2
    RENDER = 3
    GIVE_BACK = 4


@dataclass(frozen=True, slots=True)
class BorrowLease(Packet):
    """`process`: what the client drew at its start. `nonce` rises from one to the next. `lender`: who is asked, 0: any participant."""

    TYPE: ClassVar[int] = 121
    scene: SceneId
    genesis: bytes
    use: LeaseUse
    nonce: int
    lender: NodeId = _ANYBODY
    key: KeyId = _NO_KEY
    process: bytes = bytes(16)
    signature: bytes = b""

    def signable(self) -> bytes:
        """What the client's key signs, under the domain of leases; nothing is signed by who only looks."""
        numbers = self.nonce.to_bytes(8, "big") + self.lender.to_bytes(4, "big") + self.key.to_bytes(4, "big")
        return self.genesis + bytes((self.use,)) + numbers + self.process


@dataclass(frozen=True, slots=True)
class LentLease(Packet):
    """`left_ms`: for how long, from when the client asked; 0: nothing is lent. `is_asked_back`: please give it back as soon as you can."""

    TYPE: ClassVar[int] = 122
    nonce: int
    lender: NodeId
    position: int
    mode: SceneMode
    is_active: bool
    left_ms: int = 0
    is_asked_back: bool = False


ROWS = (
    row(
        BorrowLease,
        Carrier.TCP_HIGH,
        ("scene", SCENE),
        ("genesis", DIGEST),
        ("use", Choice(LeaseUse)),
        ("nonce", U64),
        ("lender", U32),
        ("key", U32),
        ("process", INCARNATION),
        ("signature", _SIGNATURE),
    ),
    row(
        LentLease,
        Carrier.TCP_HIGH,
        ("nonce", U64),
        ("lender", U32),
        ("position", U64),
        ("mode", Choice(SceneMode)),
        ("is_active", BOOL),
        ("left_ms", U32),
        ("is_asked_back", BOOL),
    ),
)
