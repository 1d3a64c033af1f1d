"""Sealing and judging the datagrams of one node at one port, without a network (specs/03-wire.md, Datagrams).

Whom the cluster does not know has no key, so nothing of it is opened; of a known node nothing counts before it has opened, and
nothing twice. Who is known is asked each time: a key that was revoked a moment ago counts no longer.

Nodes send from the address that is their id, so what says otherwise is dropped before any key is looked for. Who can write any source
on a datagram still makes us derive keys for salts that it invents; of these we derive only so many: of all together, and beyond that
a few of each node that nobody else takes away. So who writes one address, or many, keeps no node of another one from being met.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial

from scenefold.base.errors import DamagedData
from scenefold.base.ids import NodeId, address_of
from scenefold.base.limits import DATAGRAM_BYTES_MAX, NODES_MAX
from scenefold.crypto import SALT_BYTES, DatagramKey, SealingKey, SealingPublicKey, StrangeVersion, head_of
from scenefold.peer.datagrams.contents import PACKET_BYTES_MAX
from scenefold.peer.datagrams.pairing import Drop, Pairing, Taken
from scenefold.world.buckets import Buckets

PAIRINGS_MAX = 2 * NODES_MAX
"""Beyond it, pairings with nodes that are known no longer are forgotten; there are never more than NODES_MAX members."""
UNKNOWN_SALTS_BURST = 4_096
"""Datagrams under unknown salts that are opened at once: a few of each member, when it or we have started."""
UNKNOWN_SALTS_PER_S = 2_000.0
"""And this many more each second, of all nodes together: each costs 17 microseconds, which makes a thirtieth of a core."""
OWN_UNKNOWN_SALTS_BURST = 4
"""Of one node, when those of all are used up. One that opens is enough: what else comes under its salt is no longer unknown."""
OWN_UNKNOWN_SALTS_PER_S = 1.0
"""In the largest clusters half as many as those of all together."""

KeyOf = Callable[[NodeId], SealingPublicKey | None]
"""The key that is sealed to of a node that may send datagrams and get some; None: it may not."""


class Exchange:
    """The datagrams of this life of a node at one port. `token` draws random bytes."""

    def __init__(self, me: NodeId, cluster_id: bytes, port: int, key: SealingKey, key_of: KeyOf, token: Callable[[int], bytes]) -> None:
        self._me = me
        self._cluster_id = cluster_id
        self._port = port
        self._key = key
        self._key_of = key_of
        self._token = token
        self._salt = token(SALT_BYTES)
        self._unknown_salts = Buckets(UNKNOWN_SALTS_BURST, UNKNOWN_SALTS_PER_S)
        self._unknown_salts_of = Buckets(OWN_UNKNOWN_SALTS_BURST, OWN_UNKNOWN_SALTS_PER_S)
        """By node: only known ones come so far."""
        self._pairings: dict[NodeId, tuple[SealingPublicKey, Pairing | None]] = {}
        self._first_counter = 0
        """Pairings that were forgotten may have counted so far, and come back."""

    def seal(self, target: NodeId, packet: bytes) -> bytes | None:
        """The datagram that carries a packet; None if the target may get none."""
        assert len(packet) <= PACKET_BYTES_MAX, f"a packet of {len(packet)} bytes"
        pairing = self._pairing(target)
        return None if pairing is None else pairing.seal(packet)

    def take(self, data: bytes, source: str, now: float) -> tuple[NodeId | None, Taken]:
        """Who sent a datagram that came from an address, and what comes of it; None if that is nobody we know."""
        if len(data) > DATAGRAM_BYTES_MAX:
            return None, Taken().drop(Drop.FOREIGN, f"it is too long, {len(data)} bytes")
        try:
            head = head_of(data)
        except DamagedData as problem:
            return None, Taken().drop(Drop.VERSION if isinstance(problem, StrangeVersion) else Drop.FOREIGN, str(problem))
        if head.target != self._me:
            return None, Taken().drop(Drop.MISDIRECTED, f"it is for {address_of(head.target)}")
        if (sender := address_of(head.sender)) != source:
            return None, Taken().drop(Drop.ELSEWHERE, f"it says that it is from {sender}")
        pairing = None if head.sender == self._me else self._pairing(head.sender)
        if pairing is None:
            return None, Taken().drop(Drop.STRANGER, f"it is from {sender}")
        return head.sender, pairing.take(head, data, now)

    def unmet(self, nodes: Iterable[NodeId]) -> list[tuple[NodeId, SealingPublicKey]]:
        """Those of the nodes that a secret must be agreed on with first, which takes 40 microseconds each."""
        found = ((node, self._key_of(node)) for node in nodes)
        return [(node, key) for node, key in found if key is not None and self._pairings.get(node, (None,))[0] != key]

    def agree(self, keys: Sequence[SealingPublicKey]) -> list[bytes | None]:
        """The secrets with these keys, for `meet`. Pure, so that a worker can do it."""
        return [self._agreed(key) for key in keys]

    def meet(self, node: NodeId, key: SealingPublicKey, secret: bytes | None) -> None:
        """Begin with a node; `secret` None: its key agrees on none, and nothing is exchanged with it."""
        if self._pairings.get(node, (None,))[0] == key:
            return
        self._forget(node)
        if len(self._pairings) >= PAIRINGS_MAX:
            for other in [other for other, (known, _) in self._pairings.items() if self._key_of(other) != known]:
                self._forget(other)
        pairing = None
        if secret is not None:
            outgoing = DatagramKey(secret, self._cluster_id, self._port, self._me, node, self._salt)
            incoming = partial(DatagramKey, secret, self._cluster_id, self._port, node, self._me)
            pairing = Pairing(outgoing, incoming, self._token, partial(self._may_derive, node), self._first_counter)
        self._pairings[node] = key, pairing

    def _pairing(self, node: NodeId) -> Pairing | None:
        key = self._key_of(node)
        if key is None:
            return None
        known = self._pairings.get(node)
        if known is None or known[0] != key:
            self.meet(node, key, self._agreed(key))
            known = self._pairings[node]
        return known[1]

    def _agreed(self, key: SealingPublicKey) -> bytes | None:
        try:
            return self._key.agree(key)
        except DamagedData:
            return None

    def _may_derive(self, node: NodeId, now: float) -> bool:
        return self._unknown_salts.take("", now) or self._unknown_salts_of.take(str(node), now)

    def _forget(self, node: NodeId) -> None:
        _, pairing = self._pairings.pop(node, (None, None))
        if pairing is not None:
            self._first_counter = max(self._first_counter, pairing.counter)
