"""Packets of gossip, filled (specs/11-peers.md, Gossip).

A page is the own new status and behind it those of others, as many as fit one datagram. The next page goes on where
this one ended, whoever gets it.
"""

from __future__ import annotations

from scenefold.base.ids import NodeId
from scenefold.peer.datagrams import PACKET_BYTES_MAX
from scenefold.peer.membership.roster import Roster
from scenefold.peer.membership.status import OwnStatus
from scenefold.wire import PingBroadcast, Status, encode_packet


class Pages:
    """Makes this node's broadcasts and answers."""

    def __init__(self, own: OwnStatus, roster: Roster) -> None:
        self._own = own
        self._roster = roster
        self._sizes: dict[NodeId, tuple[int, int]] = {}

    def page(self, request_id: int) -> bytes:
        """A PingBroadcast with the own status and the next part of the table."""
        own = self._own.signed()
        others = self._roster.page(_PAGE_BYTES - _size_of(own), self._known_size_of)
        return encode_packet(PingBroadcast((own, *others), request_id=request_id))

    def _known_size_of(self, status: Status) -> int:
        """Statuses are passed on many times, and measured once."""
        lamport, size = self._sizes.get(status.node, (-1, 0))
        if lamport != status.lamport:
            size = _size_of(status)
            self._sizes[status.node] = (status.lamport, size)
        return size


_EMPTY_PING_BYTES = len(encode_packet(PingBroadcast(())))
_HEADS_BYTES = 6
"""What the heads of a request id and of a longer array may add."""
_PAGE_BYTES = PACKET_BYTES_MAX - _EMPTY_PING_BYTES - _HEADS_BYTES


def _size_of(status: Status) -> int:
    return len(encode_packet(PingBroadcast((status,)))) - _EMPTY_PING_BYTES
