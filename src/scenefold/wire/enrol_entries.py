"""Entries 34 and 37 to 41 of the cluster's log: who was invited, enrolled, renewed, trusted, revoked (specs/15-cluster-log.md, Enrolling).

No secret stands in them: of an invitation its public key, of a member its certificate, and the authority's key only as sealed to a node.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from scenefold.base.limits import MEMBER_NAME_BYTES_MAX
from scenefold.wire.common import BOOL, U32, KeyId, NodeId
from scenefold.wire.containers import Struct
from scenefold.wire.kinds import Bin, Text

CARD_BYTES_MAX = 4096
FORM_BYTES_MAX = 4096
ANY_NODE = "node"
"""The name in an invitation that any node may use, whatever its address."""


@dataclass(frozen=True, slots=True)
class Trust:
    """Whether a node is trusted with the authority's key. `sealing_key`: the one that may be sealed to, so that nobody on the way puts
    another in its place (an id of 32 bits would not do: keys of the same id can be searched for); empty if trust is withdrawn.
    `sealed`: the authority's key, once somebody who has it has sealed it.
    """

    node: NodeId
    trusted: bool
    sealing_key: bytes = b""
    sealed: bytes = b""


@dataclass(frozen=True, slots=True)
class Invite:
    """Whoever holds the private half of `key` may enrol once, under this name, until `expires` (seconds since 1970)."""

    key: bytes
    name: str
    is_administrator: bool
    expires: int
    by: str


@dataclass(frozen=True, slots=True)
class Enrol:
    """An invitation is used up: this certificate (DER) was issued for it. `form`: the EnrolForm that asked for that, signed with the key of the
    invitation, so that nobody but its holder can use it, nor for anything but what the holder asked for.
    """

    form: bytes
    signature: bytes
    card: bytes


@dataclass(frozen=True, slots=True)
class RenewCard:
    """A member's newer certificate (DER), for the same keys."""

    card: bytes


@dataclass(frozen=True, slots=True)
class RevokeUser:
    """The user's key counts no longer."""

    name: str
    key: KeyId


@dataclass(frozen=True, slots=True)
class Withdraw:
    """The invitation may not be used any more."""

    invitation: bytes


EnrolEntry = Trust | Invite | Enrol | RenewCard | RevokeUser | Withdraw
INVITATION_KEY = Bin(lengths=(32,))
CARD = Bin(CARD_BYTES_MAX)
FORM_BYTES = Bin(FORM_BYTES_MAX)
FORM_SIGNATURE = Bin(lengths=(64,))
"""Invitations are of suite 1."""
MEMBER_NAME = Text(MEMBER_NAME_BYTES_MAX)
ENROL_ENTRIES: dict[int, Struct[Any]] = {
    34: Struct(Trust, ("node", U32), ("trusted", BOOL), ("sealing_key", Bin(lengths=(0, 32))), ("sealed", Bin(512))),
    37: Struct(Invite, ("key", INVITATION_KEY), ("name", MEMBER_NAME), ("is_administrator", BOOL), ("expires", U32), ("by", MEMBER_NAME)),
    38: Struct(Enrol, ("form", FORM_BYTES), ("signature", FORM_SIGNATURE), ("card", CARD)),
    39: Struct(RenewCard, ("card", CARD)),
    40: Struct(RevokeUser, ("name", MEMBER_NAME), ("key", U32)),
    41: Struct(Withdraw, ("invitation", INVITATION_KEY)),
}
