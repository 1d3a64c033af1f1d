"""What a newcomer has asked for, and with whose leave (specs/15-cluster-log.md, Enrolling). Pure.

A form is signed with the key of an invitation, and goes into the cluster's log beside the certificate that was issued for it. So not only
the node that issues judges it, by the rules here, but everybody who folds the log: an invitation is used by who holds its private half,
and for what that asked, whichever members carry the request.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.ids import NodeId, address_of, checked_node_id
from scenefold.base.reasons import RejectReason
from scenefold.crypto import ENROL_DOMAIN, Card, InvalidSignature, MemberKeys, PublicKey, check_tls_key, node_named
from scenefold.wire import MalformedPacket
from scenefold.wire.enrol_entries import Invite
from scenefold.wire.orders import EnrolForm

_SUITE_OF_NODES = 1


@dataclass(frozen=True, slots=True)
class Wanted:
    """What the certificate says that a form asks for, under the invitation that it was signed with."""

    name: str
    addresses: tuple[str, ...]
    tls_key: bytes
    keys: MemberKeys

    def check_possible(self) -> None:
        """Refused (5) unless a member can be there and use such keys."""
        try:
            check_tls_key(self.tls_key)
        except DamagedData as problem:
            raise _ill_formed(str(problem)) from problem
        node = node_named(self.name)
        if node is None:
            if self.addresses:
                raise _ill_formed(f"{self.name} cannot be at {', '.join(self.addresses)}")
            return
        check_place(node, self.addresses)
        if (self.keys.signing.suite, self.keys.sealing.suite) != (_SUITE_OF_NODES, _SUITE_OF_NODES):
            raise _ill_formed("a node's keys are of suite 1")

    def is_in(self, card: Card) -> bool:
        """Whether this card says so, all of it."""
        return (card.name, card.addresses, card.tls_key, card.keys) == (self.name, self.addresses, self.tls_key, self.keys)


def form_in(data: bytes) -> EnrolForm:
    """The form that a newcomer has signed; Refused (5) if it is none."""
    try:
        return EnrolForm.decode(data)
    except MalformedPacket as problem:
        raise _ill_formed(str(problem)) from problem


def check_signed(data: bytes, signature: bytes, invitation: bytes) -> None:
    """Refused (4) unless who asks holds the private half of the invitation."""
    try:
        PublicKey(invitation).verify(signature, ENROL_DOMAIN, data)
    except InvalidSignature:
        raise Refused(RejectReason.SIGNATURE_INVALID, "the request was not signed with the token's key") from None
    except DamagedData as problem:
        raise _ill_formed(str(problem)) from problem


def wanted(form: EnrolForm, invite: Invite) -> Wanted:
    """What this form asks for. A user is told its name by the cluster; a node's is its address. Who administers says the invitation."""
    try:
        keys = replace(MemberKeys.decode(form.keys), is_administrator=invite.is_administrator)
    except DamagedData as problem:
        raise _ill_formed(str(problem)) from problem
    name = form.name or invite.name
    is_somewhere = form.address != 0 or node_named(name) is not None
    return Wanted(name, (address_of(form.address),) if is_somewhere else (), form.tls_key, keys)


def check_place(node: NodeId, addresses: tuple[str, ...]) -> None:
    """Refused unless a node is at its own address and nowhere else, and that is one that a machine can have."""
    if addresses != (address_of(node),):
        raise _ill_formed(f"node:{node} cannot be at {', '.join(addresses) or 'no address'}")
    try:
        checked_node_id(address_of(node))
    except ValueError as problem:
        raise _ill_formed(str(problem)) from problem


def _ill_formed(what: str) -> Refused:
    return Refused(RejectReason.ILL_FORMED, what)
