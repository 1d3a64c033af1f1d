"""What a client sees of the cluster's log: who is a member by which keys, and who is one no more (specs/15-cluster-log.md, Who is who).

Every record is signed with the log's key, or bears the votes by which it was decided once voters are named, and has the hash of the one before,
so whoever shows it can leave off its end and nothing else.
A node folds the whole log (peer/cluster_log/registry.py), whose entries its voter has judged; here only what clients ask for is kept. Values.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, TypeAlias

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.ids import KeyId, NodeId
from scenefold.base.reasons import RejectReason
from scenefold.consensus import Certificate, Participant, Participants
from scenefold.crypto import LOG_DOMAIN, Card, PublicKey, key_id_of
from scenefold.wire import (
    NO_RECORD,
    AddNode,
    AddParticipant,
    DecidedValue,
    Found,
    LogRecord,
    Member,
    RemoveNode,
    RemoveParticipant,
    RevokeNode,
    SignedRecord,
    hash_of_record,
)
from scenefold.wire.enrol_entries import Enrol, Invite, RenewCard, RevokeUser, Trust, Withdraw
from scenefold.world.roll import Roll

NO_INCARNATION = bytes(16)
"""Of a founder that never came."""


KeptRecord: TypeAlias = SignedRecord | DecidedValue
"""By the log's key, or by votes."""


class NodeKeys(NamedTuple):
    """Ed25519 and X25519, raw."""

    signing: bytes
    sealing: bytes

    @property
    def signing_id(self) -> KeyId:
        return key_id_of(self.signing)


class Removal(NamedTuple):
    """Who was taken off the line at which position, why, and which node proposed it. With no incarnation: a founder that never came."""

    member: Member
    reason: str
    position: int
    by: NodeId


@dataclass(frozen=True, slots=True)
class LogView:
    """As of one position. `nodes`: the keys with which nodes founded the cluster or were added to it, newest."""

    position: int = 0
    head: bytes = NO_RECORD
    roll: Roll = field(default_factory=Roll)
    nodes: Mapping[NodeId, NodeKeys] = field(default_factory=dict)
    revoked_at: Mapping[tuple[str, KeyId], int] = field(default_factory=dict)
    """Where in the log keys ceased to count."""
    order: tuple[NodeId, ...] = ()
    """The line, founders that have not registered yet included."""
    registered: Mapping[NodeId, bytes] = field(default_factory=dict)
    """The nodes that came, each with its incarnation."""
    removals: tuple[Removal, ...] = ()
    """All that there were, oldest first."""
    voters: Participants | None = None
    """Who decides the next position by votes; None as long as the log's key does."""

    def on_line(self, node: NodeId) -> Member | None:
        """A node as it stands on the line; with no incarnation a founder that never came, None for one that does not stand there."""
        return Member(node, self.registered.get(node, NO_INCARNATION)) if node in self.order else None

    @property
    def members(self) -> tuple[NodeId, ...]:
        """The registered nodes in the order of the line."""
        return tuple(node for node in self.order if node in self.registered)

    def keys_of(self, node: NodeId) -> NodeKeys | None:
        """What a node signs with, and what is sealed to it; None if it has no keys that count."""
        name = f"node:{node}"
        card = self.roll.card_of(name)
        keys = self.nodes.get(node) if card is None else NodeKeys(card.keys.signing.raw, card.keys.sealing.raw)
        return None if keys is None or self.roll.is_revoked(name, keys.signing_id) else keys

    def has_known(self, node: NodeId) -> bool:
        """Whether a node has, or had at some time, keys in this log."""
        return node in self.nodes or f"node:{node}" in self.roll.cards

    def refusal_of(self, name: str, key: KeyId | None) -> Refused | None:
        """Why a member under this key is none any more; None if this log knows nothing against it."""
        if key is None or not self.roll.is_revoked(name, key):
            return None
        at = f" (position {self.revoked_at[name, key]} of the cluster's log)" if (name, key) in self.revoked_at else ""
        return Refused(RejectReason.KEY_REVOKED, f"the key of {name} is revoked{at}", remedy="ask an administrator for a new invitation")

    def after(self, records: Sequence[KeptRecord], key: PublicKey | None, genesis: bytes = b"") -> tuple[LogView, list[KeptRecord]]:
        """The view after those of the records that it lacks, and these. `key`: the log's; None for what was verified before.

        DamagedData (a wrong signature, or too few votes), MalformedPacket, or Refused: then nothing of them counts.
        """
        view, fresh = self, list[KeptRecord]()
        for kept in records:
            if key is not None and isinstance(kept, SignedRecord):
                key.verify(kept.signature, LOG_DOMAIN, kept.record)
            record = kept.decoded() if isinstance(kept, SignedRecord) else LogRecord.decode(kept.value.data)
            if record.position > view.position:
                view._check_decider(kept, None if key is None else genesis)
                view = view._followed(record, hash_of_record(kept.record if isinstance(kept, SignedRecord) else kept.value.data))
                fresh.append(kept)
        return view, fresh

    def _check_decider(self, kept: KeptRecord, genesis: bytes | None) -> None:
        """DamagedData unless those have decided the next record who may. `genesis` None: its votes were verified before."""
        if isinstance(kept, SignedRecord) or self.voters is None:
            if isinstance(kept, SignedRecord) is not (self.voters is None):
                who = "its key does not any more" if self.voters is not None else "nobody votes yet"
                raise DamagedData(f"behind position {self.position} of the cluster's log {who}")
            return
        certificate = Certificate(kept.position, kept.ballot, kept.votes)
        if kept.position != self.position + 1 or kept.value.body:
            raise DamagedData(f"what is shown as decided is no record for position {self.position + 1}")
        if genesis is not None and not certificate.proves(kept.value, genesis, self.voters):
            raise DamagedData(f"too few voters have decided what is shown at position {kept.position}")

    def _followed(self, record: LogRecord, record_hash: bytes) -> LogView:
        if record.position != self.position + 1 or record.prev_hash != self.head:
            raise DamagedData(f"record {record.position} does not follow what is known, which ends at {self.position}")
        roll, nodes, order, registered, entry = self.roll, self.nodes, self.order, self.registered, record.entry
        removals, voters = self.removals, self.voters
        match entry:
            case AddParticipant(member, key):
                one = Participant(member, PublicKey(key))
                voters = Participants((one,)) if voters is None else voters.joined_by(one)
            case RemoveParticipant(member) if voters is not None:
                voters = voters.left_by(member)
            case Found():
                if not entry.voters or entry.voters[0] not in [founder.node for founder in entry.founders]:
                    raise DamagedData("its first voter did not found the cluster")
                nodes = {founder.node: NodeKeys(founder.key, founder.sealing_key) for founder in entry.founders}
                roll, order = roll.after(Trust(entry.voters[0], True, nodes[entry.voters[0]].sealing)), tuple(nodes)
            case AddNode():
                node = entry.member.node
                nodes, registered = {**nodes, node: NodeKeys(entry.key, entry.sealing_key)}, {**registered, node: entry.member.incarnation}
                # A founder that registers stands there already.
                order = order if node in order else _with(order, node, entry.left_of)
            case RemoveNode(member, reason):
                removals = (*removals, Removal(member, reason, record.position, record.origin))
                order = tuple(node for node in order if node != member.node)
                registered = {node: incarnation for node, incarnation in registered.items() if node != member.node}
            case RevokeNode(node, key):
                roll = roll.without(f"node:{node}", key)
            case Trust() | Invite() | Enrol() | RenewCard() | RevokeUser() | Withdraw():
                roll = roll.after(entry)
        revoked_at = self.revoked_at
        if roll.revoked is not self.roll.revoked:
            revoked_at = {**revoked_at, **dict.fromkeys(roll.revoked - self.roll.revoked, record.position)}
        return LogView(record.position, record_hash, roll, nodes, revoked_at, order, registered, removals, voters)

    def cards(self, owners: Sequence[bytes]) -> list[Card]:
        """The newest cards of all members that have one and count, by name. `owners`: of the users that the cluster began with."""
        known = {card.name: card for card in map(Card.read, owners)} | dict(self.roll.cards)
        return [known[name] for name in sorted(known) if not self.roll.is_revoked(name, known[name].signing_id)]

    def card_of(self, name: str, owners: Sequence[bytes]) -> Card | None:
        """The newest card of a member, if it has one and counts."""
        return next((card for card in self.cards(owners) if card.name == name), None)


def _with(order: tuple[NodeId, ...], node: NodeId, left_of: NodeId) -> tuple[NodeId, ...]:
    """The line with one more node, directly left of another one."""
    if left_of not in order:
        raise DamagedData("a node stands beside one that is not on the line")
    rank = order.index(left_of)
    return (*order[:rank], node, *order[rank:])
