"""Who is a member, and in which order members stand on the line: the fold of the cluster's log (specs/15-cluster-log.md).

Consensus decides membership and order, and nothing else does: gossip only tells who seems alive, and neighbours only
move the bounds between them (design page storage, Members and owners). So "who is on my left" is a pure function of the log,
and two nodes with equal logs agree on it. The order changes by two entries only: AddNode puts a node directly left of
another one (or on its founding seat), RemoveNode takes one out. An incarnation that was removed never comes back.

Everything here is a value; `extended` answers a new one, and copies once for however many records it is given.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from scenefold.base.errors import Refused
from scenefold.base.ids import KeyId, NodeId, address_of
from scenefold.base.limits import NODES_MAX
from scenefold.base.location import Arc, arcs_between, even_right_bounds
from scenefold.base.reasons import RejectReason
from scenefold.crypto import PublicKey, SealingPublicKey
from scenefold.peer.cluster_log.registered import (
    NO_INCARNATION,
    Committed,
    Registered,
    Removal,
    Seat,
    check_address,
    committed,
    inserted,
    sealing_key_from,
    signing_key_from,
)
from scenefold.peer.cluster_log.voter_rules import VoterList, check_voters_stay
from scenefold.wire import NO_RECORD, AddNode, AddParticipant, Found, LogEntry, LogRecord, Member, RemoveNode, RemoveParticipant, RevokeNode
from scenefold.wire.enrol_entries import Enrol, Invite, RenewCard, RevokeUser, Trust, Withdraw
from scenefold.world.roll import Roll, card_in


class Registry:
    """The members as of one position of the log. Immutable; `Registry()` is the one before the first record."""

    __slots__ = (
        "_founders",
        "_founding_arcs",
        "_ranks",
        "_registered",
        "_removals",
        "_requests",
        "_revoked",
        "head",
        "left_at",
        "order",
        "position",
        "roll",
        "voting",
    )

    position: int
    """Of the newest record; 0 if there is none."""
    head: bytes
    """Hash of the newest record."""
    order: tuple[NodeId, ...]
    """All nodes on the line from left to right, founders that have not registered yet included."""
    voting: VoterList
    roll: Roll
    """Who was invited, enrolled, trusted, revoked."""
    left_at: int
    """Position of the newest record that took somebody off the line, a founder that never registered included; 0 if none did."""

    def __init__(self) -> None:
        self.position = 0
        self.head = NO_RECORD
        self.order = ()
        self.voting = VoterList()
        self.left_at = 0
        self._founders: dict[NodeId, Seat] = {}
        self._registered: dict[NodeId, Registered] = {}
        self._removals: dict[bytes, Removal] = {}
        self._requests: dict[bytes, Committed] = {}
        self._revoked: frozenset[tuple[NodeId, KeyId]] = frozenset()
        self.roll = Roll()
        self._ranks: dict[NodeId, int] = {}
        self._founding_arcs: dict[NodeId, Arc] = {}

    # ------------------------------------------------------------------------------------------------- questions

    @property
    def members(self) -> tuple[NodeId, ...]:
        """The registered nodes in the order of the line."""
        return tuple(node for node in self.order if node in self._registered)

    def current(self, node: NodeId) -> Registered | None:
        """The registered incarnation of a node; None if it has none."""
        return self._registered.get(node)

    def is_current(self, member: Member) -> bool:
        """Whether this incarnation of this node is the registered one."""
        known = self._registered.get(member.node)
        return known is not None and known.incarnation == member.incarnation

    def removal(self, incarnation: bytes) -> Removal | None:
        """Why an incarnation is no member any more; None if it was never removed."""
        return self._removals.get(incarnation)

    @property
    def removed(self) -> Mapping[bytes, Removal]:
        """All removed incarnations, oldest first."""
        return self._removals

    def is_lost(self, member: Member) -> bool:
        """Whether an incarnation was removed and had not handed over before what it had."""
        removal = self._removals.get(member.incarnation)
        return removal is not None and removal.is_loss

    @property
    def lost(self) -> list[Member]:
        """All those, the newest last."""
        return [removal.member for removal in self._removals.values() if removal.is_loss]

    def stands(self, node: NodeId) -> bool:
        """Whether the node is on the line, registered or as a founder."""
        return node in self._ranks

    def rank(self, node: NodeId) -> int:
        """The node's index in `order`; KeyError if it is not on the line."""
        return self._ranks[node]

    def neighbours(self, node: NodeId) -> tuple[NodeId | None, NodeId | None]:
        """Who stands directly left and right of a node, None at the ends; KeyError if it is not on the line."""
        rank = self._ranks[node]
        return (self.order[rank - 1] if rank else None), (self.order[rank + 1] if rank + 1 < len(self.order) else None)

    def vacant_seat(self, node: NodeId) -> Seat | None:
        """The founder's seat that the node may still take; None if it is none, or has registered, or was removed."""
        return self._founders.get(node) if node in self._ranks and node not in self._registered else None

    def founding_arc(self, node: NodeId) -> Arc | None:
        """The arc that a founder begins with: even shares in founders' order. None for everybody else, and for one that came
        back otherwise."""
        known = self._registered.get(node)
        if known is not None and not known.founding:
            return None
        return self._founding_arcs.get(node) if node in self._ranks else None

    def key_of(self, node: NodeId) -> PublicKey | None:
        """The key that a node on the line signs with."""
        known = self._known(node)
        return None if known is None else known.key

    def sealing_key_of(self, node: NodeId) -> SealingPublicKey | None:
        """The key that datagrams to and from a node on the line are sealed with."""
        known = self._known(node)
        return None if known is None else known.sealing_key

    def _known(self, node: NodeId) -> Registered | Seat | None:
        return (self._registered.get(node) or self._founders.get(node)) if node in self._ranks else None

    def is_revoked(self, node: NodeId, key: KeyId) -> bool:
        return (node, key) in self._revoked

    def is_barred(self, node: NodeId) -> bool:
        """Whether a node's key was revoked and it has no other one that counts: nobody talks to it."""
        if not self._revoked or self.roll.card_of(f"node:{node}") is not None:
            return False
        known = self._registered.get(node)
        if known is not None:
            return self.is_revoked(node, known.key.key_id)
        return any(revoked == node for revoked, _ in self._revoked)

    def is_trusted(self, node: NodeId) -> bool:
        return node in self.roll.trusted

    @property
    def issuers(self) -> frozenset[NodeId]:
        """The trusted nodes that the authority's key is sealed to."""
        return self.roll.trusted & {*self.roll.sealed, *self.voting.endowed}

    @property
    def voters(self) -> tuple[NodeId, ...]:
        return self.voting.nodes

    def position_of(self, request_id: bytes) -> int | None:
        """Where a request was committed, whatever it asked for; None if it was not."""
        known = self._requests.get(request_id)
        return None if known is None else known.position

    def committed_at(self, request_id: bytes, entry: LogEntry) -> int | None:
        """Where this was committed, or None. Refused (5) if another entry was, under the same id."""
        known = self._requests.get(request_id)
        return None if known is None else known.of(entry)

    # --------------------------------------------------------------------------------------------------- changes

    def apply(self, record: LogRecord) -> Registry:
        """The registry after one more record; Refused with the reason if that record does not fit here."""
        return self.extended((record,))

    def extended(self, records: Iterable[LogRecord]) -> Registry:
        """The registry after these records, all of them or, by Refused, none."""
        after = self._copy()
        for record in records:
            after._take(record)
        after._ranks = {node: rank for rank, node in enumerate(after.order)}
        return after

    def _copy(self) -> Registry:
        copy = Registry()
        copy.position, copy.head, copy.left_at = self.position, self.head, self.left_at
        copy.order, copy.voting = self.order, self.voting
        copy._founders, copy._founding_arcs = self._founders, self._founding_arcs
        copy._revoked, copy.roll = self._revoked, self.roll
        copy._registered, copy._removals, copy._requests = dict(self._registered), dict(self._removals), dict(self._requests)
        return copy

    def _take(self, record: LogRecord) -> None:
        if record.position != self.position + 1:
            reason = RejectReason.POSITION_BEHIND if record.position <= self.position else RejectReason.PEER_MISSED
            raise Refused(reason, f"position {record.position} does not follow {self.position}")
        if record.prev_hash != self.head:
            raise _ill_formed("the record belongs behind another one than the newest here")
        if record.request_id in self._requests:
            raise _ill_formed("this request is in the log already")
        check_voters_stay(self, record.entry)
        match record.entry:
            case Found():
                self._found(record.entry)
            case AddNode():
                self._add(record.entry, record.position)
            case RemoveNode():
                self._remove(record.entry, record.position)
            case RevokeNode(node, key):
                self._revoked = self._revoked | {(node, key)}
                self.roll = self.roll.without(f"node:{node}", key)
            case AddParticipant() | RemoveParticipant():
                self.voting = self.voting.after(self, record.entry, record.position)
            case Enrol(card=card):
                self.roll, self.voting = self.roll.after(record.entry), self.voting.begun_anew(card_in(card).name)
            case Trust() | Invite() | RenewCard() | RevokeUser() | Withdraw():
                self.roll = self.roll.after(record.entry)
            case _:
                raise _ill_formed(f"a {type(record.entry).__name__} has no place in the cluster's log")
        if not self.order:
            raise _ill_formed("a cluster's log begins with its founders")
        taken = committed(record)
        self.position, self.head = taken.position, taken.record_hash
        self._requests[record.request_id] = taken

    def _found(self, entry: Found) -> None:
        nodes = [founder.node for founder in entry.founders]
        if self.position:
            raise _ill_formed("a cluster is founded once")
        if not nodes or len(nodes) > NODES_MAX or nodes != sorted(set(nodes)):
            raise _ill_formed("founders stand in id order, each once")
        if not entry.voters or not set(entry.voters) <= set(nodes) or len(set(entry.voters)) != len(entry.voters):
            raise _ill_formed("voters are founders, each once")
        for founder in entry.founders:
            check_address(founder.node, founder.address)
        self._founders = {
            founder.node: Seat(founder.node, signing_key_from(founder.key), sealing_key_from(founder.sealing_key), founder.address)
            for founder in entry.founders
        }
        self._founding_arcs = dict(zip(nodes, arcs_between(even_right_bounds(len(nodes))), strict=True))
        self.order = tuple(nodes)
        self.voting = VoterList.founded(entry.voters)
        # It was given the authority's key when the cluster was made.
        self.roll = self.roll.after(Trust(entry.voters[0], True, self._founders[entry.voters[0]].sealing_key.raw))

    def _add(self, entry: AddNode, position: int) -> None:
        member = entry.member
        node, incarnation = member.node, member.incarnation
        check_address(node, entry.address)
        if incarnation == NO_INCARNATION:
            raise _ill_formed("a member has an incarnation")
        if incarnation in self._removals:
            raise Refused(RejectReason.WRONG_INCARNATION, f"this incarnation was removed: {self._removals[incarnation].reason}")
        key, sealing_key = signing_key_from(entry.key), sealing_key_from(entry.sealing_key)
        if self.is_revoked(node, key.key_id):
            raise Refused(RejectReason.KEY_REVOKED, f"the key of {address_of(node)} is revoked")
        if node in self._registered:
            raise Refused(RejectReason.BUSY, f"id in use: {address_of(node)} is a member already")
        founding = entry.left_of == 0
        if founding:
            seat = self._founders.get(node)
            if seat is None or node not in self.order:
                raise _ill_formed(f"{address_of(node)} has no founding seat")
            if (seat.key, seat.sealing_key) != (key, sealing_key):
                raise Refused(RejectReason.NOT_AUTHORISED, f"the founding seat of {address_of(node)} waits for other keys")
        else:
            self.order = inserted(self.order, node, entry.left_of)
        self._registered[node] = Registered(node, incarnation, key, sealing_key, entry.address, position, founding)

    def _remove(self, entry: RemoveNode, position: int) -> None:
        node, incarnation = entry.member.node, entry.member.incarnation
        if node not in self.order:
            raise _ill_formed(f"{address_of(node)} is not on the line")
        if node in self.voters:
            raise Refused(RejectReason.NOT_AUTHORISED, f"{address_of(node)} is a voter, and voters are not removed")
        known = self._registered.get(node)
        if incarnation != (NO_INCARNATION if known is None else known.incarnation):
            raise Refused(RejectReason.WRONG_INCARNATION, f"this is not the incarnation of {address_of(node)} that is a member")
        self.order = tuple(other for other in self.order if other != node)
        self.left_at = position
        if known is not None:
            del self._registered[node]
            self._removals[incarnation] = Removal(entry.member, entry.reason, position)


def _ill_formed(what: str) -> Refused:
    return Refused(RejectReason.ILL_FORMED, what)
