"""How often a source may knock and shake hands at one port (specs/03-wire.md, Limits). Pure.

A connection that says nothing is cheap, so many may come; a handshake costs a millisecond and more of the thread that does all
else. Both are given back to their source if the handshake ends well: only those that lead to nothing count against an address,
behind which many honest ones may be. And a peer that comes in again and again gets back only so many.
"""

from __future__ import annotations

from scenefold.base.limits import (
    HANDSHAKES_BURST,
    HANDSHAKES_PER_S,
    KNOCKS_BURST,
    KNOCKS_PER_S,
    NEWCOMERS_BURST,
    NEWCOMERS_PER_S,
    PEER_HANDSHAKES_BURST,
    PEER_HANDSHAKES_PER_S,
)
from scenefold.world.buckets import Buckets

HELLO_BYTES = 6
PAUSE_S_MIN, PAUSE_S_MAX = 0.005, 0.1
REFUSED_PER_WELCOME = 8
_HANDSHAKE, _MAJOR, _CLIENT_HELLO = 22, 3, 1


class Admission:
    """Remembers sources, which are addresses, and peers, which are names in certificates."""

    def __init__(self) -> None:
        self._knocks = Buckets(KNOCKS_BURST, KNOCKS_PER_S)
        self._handshakes = Buckets(HANDSHAKES_BURST, HANDSHAKES_PER_S)
        self._newcomers = Buckets(NEWCOMERS_BURST, NEWCOMERS_PER_S)
        self._peers = Buckets(PEER_HANDSHAKES_BURST, PEER_HANDSHAKES_PER_S)

    def may_knock(self, source: str, now: float) -> bool:
        """Whether a connection that has just come may stay. Whoever may not shake hands need not wait to be told."""
        return self._handshakes.has(source, now) and self._knocks.take(source, now)

    def may_shake_hands(self, source: str, now: float) -> bool:
        """Whether TLS may begin on one."""
        return self._handshakes.take(source, now)

    def came_in(self, source: str, peer: str, now: float) -> None:
        """The handshake has shown who it is."""
        if self._peers.take(peer, now):
            self._handshakes.give_back(source, now)
            self._knocks.give_back(source, now)

    def may_ask(self, source: str, now: float) -> bool:
        """Whether a newcomer may stay, after its handshake."""
        return self._newcomers.take(source, now)

    def was_expected(self, source: str, now: float) -> None:
        """A newcomer has shown an open invitation."""
        self._newcomers.give_back(source, now)


class Pauses:
    """How long a listener leaves what comes in the system's queue, once it has taken all that was there."""

    def __init__(self) -> None:
        self._pause_s = 0.0
        self._refused = self._let_in = 0

    def refused(self) -> None:
        self._refused += 1

    def let_in(self) -> None:
        self._let_in += 1

    def next_s(self) -> float:
        """The queue is empty: twice the pause before if nearly all was refused since then, else none."""
        is_pointless = self._refused > REFUSED_PER_WELCOME * self._let_in
        self._pause_s = min(PAUSE_S_MAX, max(PAUSE_S_MIN, 2 * self._pause_s)) if is_pointless else 0.0
        self._refused = self._let_in = 0
        return self._pause_s


def begins_tls(first: bytes) -> bool:
    """Whether the first bytes of a connection, HELLO_BYTES or fewer, may be those of a TLS handshake."""
    expected = {0: _HANDSHAKE, 1: _MAJOR, 5: _CLIENT_HELLO}
    return bool(first) and all(byte == expected.get(index, byte) for index, byte in enumerate(first[:HELLO_BYTES]))
