"""Packets 77 to 84: becoming a member, and administering who is one (specs/15-cluster-log.md, Enrolling).

77 to 79 are all that is said on a connection of a newcomer, which has no certificate yet.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from scenefold.wire.common import SIGNATURE, U64, Carrier, Packet, row
from scenefold.wire.enrol_entries import CARD, FORM_BYTES, FORM_SIGNATURE
from scenefold.wire.kinds import Bin
from scenefold.wire.orders import ORDER_BYTES_MAX

CHARTER_BYTES_MAX = 256 * 1024


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
class RequestCard(Packet):
    """What is your certificate? Of a node that was there from the start the log has only the keys."""

    TYPE: ClassVar[int] = 83


@dataclass(frozen=True, slots=True)
class RespondCard(Packet):
    """The node's own certificate (DER); empty if it has none."""

    TYPE: ClassVar[int] = 84
    card: bytes


ROWS = (
    row(Greeting, Carrier.TCP_HIGH, ("authority", CARD)),
    row(RequestEnrolment, Carrier.TCP_HIGH, ("form", FORM_BYTES), ("signature", FORM_SIGNATURE)),
    row(Enrolled, Carrier.TCP_HIGH, ("certificate", CARD), ("authority", CARD), ("charter", Bin(CHARTER_BYTES_MAX))),
    row(RequestRenewal, Carrier.TCP_HIGH, ("certificate", CARD)),
    row(Administer, Carrier.TCP_HIGH, ("order", Bin(ORDER_BYTES_MAX)), ("signature", SIGNATURE)),
    row(Administered, Carrier.TCP_HIGH, ("position", U64)),
    row(RequestCard, Carrier.TCP_HIGH),
    row(RespondCard, Carrier.TCP_HIGH, ("card", CARD)),
)
