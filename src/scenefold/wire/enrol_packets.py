"""Packets 77 to 84: becoming a member, and administering who is one (specs/15-cluster-log.md, Enrolling).

77 to 79 are all that is said on a connection of a newcomer, which has no certificate yet.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import ClassVar

from scenefold.base.limits import NODES_MAX
from scenefold.wire.common import BOOL, SIGNATURE, U32, U64, Carrier, NodeId, Packet, row
from scenefold.wire.containers import Many, Struct
from scenefold.wire.enrol_entries import CARD, INVITATION_KEY, MEMBER_NAME
from scenefold.wire.kinds import Bin, Choice
from scenefold.wire.orders import FORM_BYTES_MAX, ORDER_BYTES_MAX

CHARTER_BYTES_MAX = 256 * 1024
LISTED_MAX = 2048


@dataclass(frozen=True, slots=True)
class Greeting(Packet):
    """A node's first words to a newcomer: the authority's certificate (DER), by which it can tell whose node this is."""

    TYPE: ClassVar[int] = 77
    authority: bytes


@dataclass(frozen=True, slots=True)
class RequestEnrolment(Packet):
    """`form`: an EnrolForm, signed with the key of the invitation."""

    TYPE: ClassVar[int] = 78
    form: bytes
    signature: bytes


@dataclass(frozen=True, slots=True)
class Enrolled(Packet):
    """The certificate (DER) that was asked for. `charter`: empty to whom it is known."""

    TYPE: ClassVar[int] = 79
    certificate: bytes
    authority: bytes
    charter: bytes


@dataclass(frozen=True, slots=True)
class RequestRenewal(Packet):
    """A newer certificate for the keys of this one (DER), the asker's own; answered by Enrolled."""

    TYPE: ClassVar[int] = 80
    certificate: bytes


@dataclass(frozen=True, slots=True)
class Administer(Packet):
    """`order`: an Order, signed by an administrator. Any node takes it to the voter."""

    TYPE: ClassVar[int] = 81
    order: bytes
    signature: bytes


@dataclass(frozen=True, slots=True)
class Administered(Packet):
    """It stands in the cluster's log, there."""

    TYPE: ClassVar[int] = 82
    position: int


@dataclass(frozen=True, slots=True)
class RequestRoll(Packet):
    """Who belongs to the cluster? `name`: this member only; empty: everybody, and the invitations."""

    TYPE: ClassVar[int] = 83
    BULK_ANSWER: ClassVar[bool] = True
    name: str


class InvitationState(IntEnum):
    OPEN = 0
    USED = 1
    WITHDRAWN = 2


@dataclass(frozen=True, slots=True)
class KnownInvitation:
    """An invitation as the log has it. Whether an open one is out of date, the reader's clock says."""

    key: bytes
    name: str
    is_administrator: bool
    expires: int
    by: str
    state: InvitationState


@dataclass(frozen=True, slots=True)
class RespondRoll(Packet):
    """`cards`: certificates (DER) of members, newest each; `revoked`: names of those whose key counts no longer."""

    TYPE: ClassVar[int] = 84
    cards: tuple[bytes, ...]
    invitations: tuple[KnownInvitation, ...]
    trusted: tuple[NodeId, ...]
    revoked: tuple[str, ...]


KNOWN_INVITATION = Struct(
    KnownInvitation,
    ("key", INVITATION_KEY),
    ("name", MEMBER_NAME),
    ("is_administrator", BOOL),
    ("expires", U32),
    ("by", MEMBER_NAME),
    ("state", Choice(InvitationState)),
)
STRUCTS = (KNOWN_INVITATION,)
ROWS = (
    row(Greeting, Carrier.TCP_HIGH, ("authority", CARD)),
    row(RequestEnrolment, Carrier.TCP_HIGH, ("form", Bin(FORM_BYTES_MAX)), ("signature", Bin(lengths=(64,)))),
    row(Enrolled, Carrier.TCP_HIGH, ("certificate", CARD), ("authority", CARD), ("charter", Bin(CHARTER_BYTES_MAX))),
    row(RequestRenewal, Carrier.TCP_HIGH, ("certificate", CARD)),
    row(Administer, Carrier.TCP_HIGH, ("order", Bin(ORDER_BYTES_MAX)), ("signature", SIGNATURE)),
    row(Administered, Carrier.TCP_HIGH, ("position", U64)),
    row(RequestRoll, Carrier.TCP_HIGH, ("name", MEMBER_NAME)),
    row(
        RespondRoll,
        Carrier.TCP_HIGH,
        ("cards", Many(CARD, LISTED_MAX)),
        ("invitations", Many(KNOWN_INVITATION, LISTED_MAX)),
        ("trusted", Many(U32, NODES_MAX)),
        ("revoked", Many(MEMBER_NAME, LISTED_MAX)),
    ),
)
