"""Through how many broadcasts each peer has stayed silent (thesis B.2.2; specs/11-peers.md, Roster). Pure.

Each node broadcasts once a second with probability 1/N. So each of the N nodes is equally likely to be the author
of the next broadcast, and a living peer has stayed silent through B of them with probability ((N-1)/N)^B (odds.py).
Counting broadcasts instead of seconds makes the odds independent of the size of the cluster, and of anybody's clock. A
node counts its own broadcasts too: otherwise one that is left alone would never notice.

B is no counter of each peer: one counter runs for all, and each peer bears a mark, the counter's value when it was
last heard. So a broadcast costs as much as it brings news, also among a thousand nodes; and peers stand in the order
of their marks, so that those who have been silent for too long are found without looking at the others.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterable

from scenefold.base.ids import NodeId
from scenefold.peer.membership.odds import broadcasts_missed_max, chance_alive


class Silence:
    """Of each peer, since it was last heard, or became one."""

    def __init__(self) -> None:
        self._broadcasts = 0
        self._marks: OrderedDict[NodeId, int] = OrderedDict()
        self._count = 1
        self._missed_max = 0

    def set_count(self, count: int) -> None:
        """N: members, this node included."""
        self._count = count
        self._missed_max = broadcasts_missed_max(count)

    def begin(self, peer: NodeId) -> None:
        """It is a peer from now on, or was heard just now."""
        self._marks[peer] = self._broadcasts
        self._marks.move_to_end(peer)

    def end(self, peer: NodeId) -> None:
        """It is no peer any more."""
        del self._marks[peer]

    def broken_by(self, member: NodeId) -> None:
        """A member was heard; strangers do not count."""
        if member in self._marks:
            self.begin(member)

    def count_broadcast(self, heard: Iterable[NodeId]) -> None:
        """A broadcast arrived that was a sign of life of `heard`: all others stayed silent through it."""
        self._broadcasts += 1
        for member in heard:
            self.broken_by(member)

    def chance_alive(self, peer: NodeId) -> float:
        """p(alive) of one that was heard before."""
        return chance_alive(self._count, self._broadcasts - self._marks[peer])

    def is_too_long(self, peer: NodeId) -> bool:
        """Whether a peer that was heard before is believed alive no longer."""
        return self._broadcasts - self._marks[peer] > self._missed_max

    def too_long(self) -> list[NodeId]:
        """The peers whose silence has lasted too many broadcasts, the longest first."""
        found = []
        for peer in self._marks:
            if not self.is_too_long(peer):
                break
            found.append(peer)
        return found
