"""Who seems alive, and what they last said of themselves (thesis B.2.2; specs/11-peers.md, Roster). Pure.

Each node broadcasts once a second with probability 1/N. So each of the N nodes is equally likely to be the author
of the next broadcast, and a living peer has stayed silent through B of them with probability ((N-1)/N)^B. The
roster counts B for every peer since the last time that it was heard, and gives that number as the chance that the
peer is alive. Counting broadcasts instead of seconds makes the odds independent of the size of the cluster, and of
anybody's clock. A node hears its own broadcasts too: otherwise one that is left alone would never notice.

A peer is heard when a status of its own arrives, from itself or relayed, with a risen Lamport time. What it says in
its requests (MiniStatus) counts likewise, since the connection is authenticated. A status under another incarnation
is that of a node whose folder was made anew: it is taken, and the old incarnation never comes back. Relayed, it is taken
only once the incarnation that we know has fallen silent: who was away for long may relay one that is long gone, and a
node that was restarted meanwhile does not know that.

Signatures are not judged here: whoever calls `hear` has verified them. `rises` says beforehand whether the work of
verifying is worth it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

from scenefold.base.ids import NodeId
from scenefold.wire import MiniStatus, Status

ALIVE_CHANCE_MIN = 1 / 20
"""Below this chance a peer is no longer believed alive (storage.md, Members and owners)."""
PAST_INCARNATIONS_MAX = 64
"""Old incarnations remembered for each member: a folder is made anew a few times in a cluster's life."""


@dataclass(slots=True)
class _Peer:
    status: Status | None = None
    lamport: int = -1
    broadcasts_missed: int = 0
    heard_at: float | None = None
    refused: bool = False
    past: list[bytes] = field(default_factory=list)


class Roster:
    """The table of registered members as one node sees it, itself included."""

    def __init__(self, me: NodeId, members: Iterable[NodeId]) -> None:
        self._me = me
        self._peers = {member: _Peer() for member in sorted(set(members)) if member != me}
        self._cursor = 0

    @property
    def count(self) -> int:
        """N: members, this node included."""
        return len(self._peers) + 1

    def rises(self, status: Status, *, relayed: bool = False) -> bool:
        """Whether hearing this status would count: a registered peer, and newer than what is known of it."""
        peer = self._peers.get(status.node)
        if peer is None or status.incarnation in peer.past:
            return False
        if self._is_newcomer(peer, status):
            return not relayed or peer.status is None or not self.is_believed_alive(status.node)
        return status.lamport > peer.lamport

    def hear(self, status: Status, now: float, *, relayed: bool = False) -> bool:
        """Take a verified status at local time `now`, `relayed` by another node or not; False if it does not count."""
        if not self.rises(status, relayed=relayed):
            return False
        peer = self._peers[status.node]
        if peer.status is not None and self._is_newcomer(peer, status):
            peer.past = [*peer.past, peer.status.incarnation][-PAST_INCARNATIONS_MAX:]
            peer.lamport = -1
        peer.status = status
        self._heard(peer, max(peer.lamport, status.lamport), now)
        return True

    def hear_mini(self, mini: MiniStatus, now: float) -> None:
        """Take the short status of an authenticated request or reply; it counts if it rises."""
        peer = self._peers.get(mini.node)
        if peer is not None and mini.lamport > peer.lamport:
            self._heard(peer, mini.lamport, now)

    def count_broadcast(self, heard: Iterable[NodeId]) -> None:
        """A broadcast arrived that brought news of `heard`: all others stayed silent through it."""
        brought = set(heard)
        for member, peer in self._peers.items():
            if member not in brought:
                peer.broadcasts_missed += 1

    def note_refusal(self, member: NodeId) -> None:
        """A request to the peer failed: it is not believed alive until it is heard again."""
        if member in self._peers:
            self._peers[member].refused = True

    def chance_alive(self, member: NodeId) -> float:
        """p(alive), 0 for a peer never heard; KeyError for a stranger."""
        if member == self._me:
            return 1.0
        peer = self._peers[member]
        if peer.heard_at is None:
            return 0.0
        return float(((self.count - 1) / self.count) ** peer.broadcasts_missed)

    def is_believed_alive(self, member: NodeId) -> bool:
        if member == self._me:
            return True
        peer = self._peers.get(member)
        return peer is not None and not peer.refused and self.chance_alive(member) >= ALIVE_CHANCE_MIN

    def alive(self) -> list[NodeId]:
        """The members believed alive, this node included, in the order of the line."""
        return sorted([self._me, *(member for member in self._peers if self.is_believed_alive(member))])

    def unheard(self) -> list[NodeId]:
        """The peers that have never been heard since this node started."""
        return [member for member, peer in self._peers.items() if peer.heard_at is None]

    def heard_at(self, member: NodeId) -> float | None:
        """Local time of the last hearing."""
        peer = self._peers.get(member)
        return None if peer is None else peer.heard_at

    def statuses(self) -> list[Status]:
        """The newest known status of every peer, in the order of the line; this node's is not in it."""
        return [peer.status for peer in self._peers.values() if peer.status is not None]

    def page(self, room: int, size_of: Callable[[Status], int]) -> Sequence[Status]:
        """The next statuses to relay, as many as fit `room` bytes, going on where the last page ended."""
        statuses = self.statuses()
        chosen: list[Status] = []
        for step in range(len(statuses)):
            status = statuses[(self._cursor + step) % len(statuses)]
            room -= size_of(status)
            if room < 0:
                break
            chosen.append(status)
        self._cursor += len(chosen)
        return chosen

    @staticmethod
    def _is_newcomer(peer: _Peer, status: Status) -> bool:
        return peer.status is None or status.incarnation != peer.status.incarnation

    @staticmethod
    def _heard(peer: _Peer, lamport: int, now: float) -> None:
        peer.lamport = lamport
        peer.heard_at = now
        peer.broadcasts_missed = 0
        peer.refused = False
