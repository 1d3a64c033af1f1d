"""Who seems alive, and what they last said of themselves (thesis B.2.2; specs/11-peers.md, Roster). Pure.

How long a peer may stay silent and be believed alive all the same: silence.py.

Who is a member says the cluster's log (`set_members`), under which incarnation too: a status of any other incarnation
never counts, whoever signed or repeated it. A peer is heard when a status of its own arrives whose Lamport time has
risen, from itself or relayed, or when it asks or answers on an authenticated connection (MiniStatus). Relayed news
say that the peer lived some time ago. So the roster also knows when a peer gave *proof* of life, to us or to a node
that we asked to probe it: only that counts when its removal is at stake.

Signatures are not judged here: whoever calls `hear` has verified them. `rises` says beforehand whether the work of
verifying is worth it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType

from scenefold.base.ids import NodeId
from scenefold.base.location import Arc
from scenefold.peer.cluster_log.member_list import MemberList
from scenefold.peer.membership.former import FormerArcs
from scenefold.peer.membership.known_peer import KnownPeer
from scenefold.peer.membership.silence import Silence
from scenefold.wire import MiniStatus, Status

NOBODYS = 0
"""The Lamport time in the mini status of who is not registered, be it that another incarnation of it is."""


class Roster:
    """The table of members as one node sees it. Itself it is in no table, but counts as a member."""

    def __init__(self, me: NodeId) -> None:
        self._me = me
        self._peers: dict[NodeId, KnownPeer] = {}
        self._order: tuple[NodeId, ...] = ()
        self._position = 0
        self._silence = Silence()
        self._refused: dict[NodeId, None] = {}
        self._unheard: dict[NodeId, None] = {}
        self.vacant_count = 0
        """Founders that have not taken their seat yet."""
        self._ring: list[NodeId] = []
        self._cursor = 0
        self._arcs: dict[NodeId, Arc | None] = {}
        self._former = FormerArcs()
        self.arcs_version = 0
        """Rises whenever `arcs` or the members change."""
        self.tell_position: Callable[[NodeId, int], None] = _tell_nobody
        """Called with (node, position) when a peer knows more of the cluster's log than we did at `set_members`."""

    # ---------------------------------------------------------------------------------------------------- members

    def set_members(self, members: MemberList, now: float) -> None:
        """Take the members of the cluster's log. Who is new, or came under a new incarnation, begins unheard."""
        peers: dict[NodeId, KnownPeer] = {}
        for node in members.order:
            if node == self._me:
                continue
            registered = members.current(node)
            incarnation = None if registered is None else registered.incarnation
            before = self._peers.get(node)
            if before is not None and before.incarnation == incarnation:
                peers[node] = before
            else:
                peers[node] = KnownPeer(incarnation, now)
                self._silence.begin(node)
                self._refused.pop(node, None)
                self._unheard.pop(node, None)
                if incarnation is not None:
                    self._unheard[node] = None
                self._former.add(self._arcs.pop(node, None), now)
        for node in [node for node in self._peers if node not in peers]:
            self._silence.end(node)
            self._refused.pop(node, None)
            self._unheard.pop(node, None)
            self._former.add(self._arcs.pop(node, None), now)
        self._peers = peers
        self.vacant_count = sum(peer.incarnation is None for peer in peers.values())
        self._ring = [node for node in self._ring if node in peers and peers[node].status is not None]
        self._order = tuple(members.order)
        self._position = members.position
        self._silence.set_count(self.count)
        self.arcs_version += 1

    @property
    def position(self) -> int:
        """That of the log at `set_members`; 0 before."""
        return self._position

    @property
    def count(self) -> int:
        """N: members, this node included."""
        return len(self._peers) + 1

    @property
    def peers(self) -> Iterable[NodeId]:
        """The other members, in the order of the line."""
        return self._peers.keys()

    def is_peer(self, member: NodeId) -> bool:
        """Whether this is another member, heard or not."""
        return member in self._peers

    # ---------------------------------------------------------------------------------------------------- hearing

    def rises(self, status: Status) -> bool:
        """Whether hearing this status would change anything: of a registered incarnation, and newer than what we have."""
        peer = self._peers.get(status.node)
        return peer is not None and peer.would_change_by(status)

    def hear(self, status: Status, now: float, *, relayed: bool = False) -> bool:
        """Take a verified status at local time `now`, `relayed` by another node or not; True if it is a sign of life.

        What a peer says itself is one if it is newer than its last status. A relayed one must also be newer than what
        the peer has said on connections since then: else it is merely taken into the table.
        """
        if not self.rises(status):
            return False
        peer = self._peers[status.node]
        is_sign = not relayed or status.lamport > peer.lamport
        if peer.status is None:
            self._unheard.pop(status.node, None)
            self._ring.append(status.node)
        peer.status = status
        self._note_arc(peer, status, now, relayed=relayed)
        if is_sign:
            self._note_sign(status.node, status.lamport, now, is_proof=not relayed)
        self.note_position(status.node, status.log_position)
        return is_sign

    def note_life(self, status: Status, now: float, *, relayed: bool = False) -> bool:
        """Take only the sign of life of a verified status whose claims cannot be judged yet; True if it is one."""
        peer = self._peers[status.node]
        is_sign = status.lamport > peer.lamport
        if is_sign:
            self._note_sign(status.node, status.lamport, now, is_proof=not relayed)
        self.note_position(status.node, status.log_position)
        return is_sign

    def hear_mini(self, mini: MiniStatus, now: float) -> bool:
        """Take the short status of an authenticated packet; True if it is a sign of life: it rises."""
        peer = self._peers.get(mini.node)
        self.note_position(mini.node, mini.log_position)
        if peer is None or peer.incarnation is None or mini.lamport <= max(peer.lamport, NOBODYS):
            return False
        if mini.log_position <= self._position:
            # Else it is early (specs/11-peers.md, Routing): its next status comes when we know as much.
            self._note_arc(peer, mini, now, relayed=False)
        self._note_sign(mini.node, mini.lamport, now, is_proof=True)
        return True

    def count_broadcast(self, heard: Iterable[NodeId]) -> None:
        """A broadcast arrived that was a sign of life of `heard`: all others stayed silent through it."""
        self._silence.count_broadcast(heard)

    def note_refusal(self, member: NodeId) -> None:
        """A request to the peer failed: it is not believed alive until it is heard again."""
        if member in self._peers:
            self._refused[member] = None

    def vouch(self, member: NodeId, now: float) -> None:
        """A node that we asked has heard the peer just now."""
        peer = self._peers.get(member)
        if peer is not None:
            peer.proof_at = now
            self._silence.broken_by(member)

    def note_position(self, node: NodeId, position: int) -> None:
        """A node says that its cluster log has come to `position`."""
        if position > self._position:
            self.tell_position(node, position)

    # -------------------------------------------------------------------------------------------------- who lives

    def chance_alive(self, member: NodeId) -> float:
        """p(alive), 0 for a peer never heard; KeyError for a stranger."""
        if member == self._me:
            return 1.0
        peer = self._peers[member]
        return 0.0 if peer.heard_at is None else self._silence.chance_alive(member)

    def is_believed_alive(self, member: NodeId) -> bool:
        if member == self._me:
            return True
        peer = self._peers.get(member)
        return peer is not None and peer.heard_at is not None and member not in self._refused and not self._silence.is_too_long(member)

    def alive(self) -> list[NodeId]:
        """The members believed alive in the order of the line; this node is in it, last if it is no member yet."""
        order = self._order if self._me in self._order else (*self._order, self._me)
        return [member for member in order if self.is_believed_alive(member)]

    def silent(self) -> list[NodeId]:
        """The peers whose silence has lasted too many broadcasts, the longest first; never heard ones likewise."""
        return self._silence.too_long()

    def refused(self) -> list[NodeId]:
        """The peers to which a request failed since they were last heard, in the order of failing."""
        return list(self._refused)

    def unheard(self) -> list[NodeId]:
        """The registered peers of which no status is known, in the order in which they became members here."""
        return list(self._unheard)

    def is_unheard(self, member: NodeId) -> bool:
        """Whether this is a registered peer of which no status is known."""
        return member in self._unheard

    @property
    def unheard_count(self) -> int:
        return len(self._unheard)

    def heard_at(self, member: NodeId) -> float | None:
        """Local time of the last sign of life, relayed ones included."""
        peer = self._peers.get(member)
        return None if peer is None else peer.heard_at

    def proof_at(self, member: NodeId) -> float | None:
        """Local time since when it cannot be known that the peer lives: its last proof of life, else since it is a
        member here; None for a stranger."""
        peer = self._peers.get(member)
        return None if peer is None else peer.proof_at

    def incarnation(self, member: NodeId) -> bytes | None:
        """The registered incarnation of a peer; None for a stranger, or a founder that never came."""
        peer = self._peers.get(member)
        return None if peer is None else peer.incarnation

    def signs(self, member: NodeId) -> int:
        """How many signs of life a peer has given, relayed ones included; 0 for a stranger."""
        peer = self._peers.get(member)
        return 0 if peer is None else peer.signs

    def proofs(self, member: NodeId) -> int:
        """How many signs of life came from the peer itself; 0 for a stranger."""
        peer = self._peers.get(member)
        return 0 if peer is None else peer.proofs

    def count_proven(self, since: float) -> int:
        """How many members have given proof of life at `since` or later, this node included. Looks at all of them."""
        return 1 + sum(peer.proofs > 0 and peer.proof_at >= since for peer in self._peers.values())

    # -------------------------------------------------------------------------------------------------- the table

    def status(self, member: NodeId) -> Status | None:
        """The newest known status of a peer."""
        peer = self._peers.get(member)
        return None if peer is None else peer.status

    def arcs(self) -> Mapping[NodeId, Arc | None]:
        """What each peer that was heard claims, the end of it be it in passing; None: it owns nothing. A live view."""
        return MappingProxyType(self._arcs)

    def former_arcs(self, now: float) -> Sequence[Arc]:
        """What those claimed whom the log has removed, until their leases are over."""
        return self._former.at(now)

    def said_at(self, member: NodeId) -> float:
        """Local time of the newest word of a peer on its arc; -inf if it has not said anything."""
        peer = self._peers.get(member)
        return -math.inf if peer is None else peer.said_at

    def statuses(self) -> list[Status]:
        """The newest known status of every peer, in the order of the line; this node's is not in it."""
        return [peer.status for peer in self._peers.values() if peer.status is not None]

    def page(self, room: int, size_of: Callable[[Status], int]) -> Sequence[Status]:
        """The next statuses to relay, as many as fit `room` bytes, going on where the last page ended."""
        chosen: list[Status] = []
        while len(chosen) < len(self._ring):
            status = self._peers[self._ring[self._cursor % len(self._ring)]].status
            assert status is not None, "only those with a status stand in the ring"
            room -= size_of(status)
            if room < 0:
                break
            chosen.append(status)
            self._cursor = (self._cursor + 1) % len(self._ring)
        return chosen

    # ---------------------------------------------------------------------------------------------------- private

    def _note_sign(self, member: NodeId, lamport: int, now: float, *, is_proof: bool) -> None:
        self._peers[member].gave_sign(lamport, now, is_proof=is_proof)
        self._refused.pop(member, None)
        self._silence.broken_by(member)

    def _note_arc(self, peer: KnownPeer, news: Status | MiniStatus, now: float, *, relayed: bool) -> None:
        peer.said(news, now, relayed=relayed)
        if news.node not in self._arcs or self._arcs[news.node] != peer.arc:
            self._arcs[news.node] = peer.arc
            self.arcs_version += 1


def _tell_nobody(_node: NodeId, _position: int) -> None:
    """Before the cluster's log listens, there is nothing to tell."""
