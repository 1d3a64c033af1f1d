"""What a node keeps of one other node's datagrams, at one port (specs/03-wire.md, Datagrams). Pure: no time, no network.

Outgoing: the key under the own salt, and a counter. Incoming: the salt that counts, and which of its counters were seen.

    a packet under the salt that counts        counts, once
    a packet under an unknown salt             is held, and a challenge sent: it may be an old one, sent again
    an answer that echoes our challenge        its salt counts from now on, and so do the packets held under it
    a challenge                                is answered, with one of our own if its salt is not the one that counts

Our challenge is drawn after the salt that counts was accepted, so whoever echoes it lives later than that: salts are accepted
in the order of the peer's boots. The answer to an answer carries no challenge, so three datagrams end what one began.

What the peer said before its answer may arrive behind it. In an earlier life of ours it may have counted, and be played again;
but not if the answer is the first that the peer has given under its salt, since no salt counts anywhere before that.
"""

from __future__ import annotations

import math
from collections import OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum

from scenefold.base.errors import DamagedData
from scenefold.crypto import DatagramHead, DatagramKey, ReplayWindow
from scenefold.peer.datagrams.contents import CHALLENGE_BYTES, Content, Kind, packed_answer, packed_challenge, packed_packet, unpacked

HELD_MAX = 4
"""Packets of one peer that wait for the answer to a challenge; beyond it the oldest goes."""
HOLD_S = 5.0
"""An answer that comes later finds nothing held any more."""
CHALLENGE_S_MIN = 0.1
"""Between two challenges to one peer: half of what one answers."""
ANSWER_S_MIN = 0.05
"""Between two answers to one peer: apart for challenges under the salt that counts, which nobody can repeat, and under each other one."""
UNPROVEN_SALTS_MAX = 1024
"""Other salts whose challenges are remembered: old ones, played again, are answered once, and never instead of those of a new boot. Whoever
has recorded more boots than these gets one answer every ANSWER_S_MIN, for all that are not remembered together."""
DEAD_SALTS_MAX = 4
"""Salts of earlier boots that are dropped without another look; older ones cost opening, and a challenge now and then."""


@dataclass(slots=True)
class Unproven:
    """What was answered under a salt that does not count."""

    counter: int = -1
    """Of the last challenge: none up to it is answered again."""
    at: float = -math.inf


class Drop(StrEnum):
    """Why a datagram does not count."""

    FOREIGN = "foreign"
    VERSION = "version"
    STRANGER = "stranger"
    MISDIRECTED = "misdirected"
    ELSEWHERE = "elsewhere"
    FORGED = "forged"
    REPEATED = "repeated"
    STALE = "stale"
    UNASKED = "unasked"
    CROWDED = "crowded"


@dataclass(slots=True)
class Taken:
    """What came of a datagram: packets that count now, oldest first; datagrams to be sent back before them; what was dropped, and why."""

    packets: list[bytes] = field(default_factory=list)
    replies: list[bytes] = field(default_factory=list)
    dropped: list[tuple[Drop, str]] = field(default_factory=list)

    def drop(self, why: Drop, text: str) -> Taken:
        self.dropped.append((why, text))
        return self


@dataclass(slots=True)
class Held:
    """A packet under a salt that does not count yet."""

    salt: bytes
    counter: int
    packet: bytes
    at: float


class Pairing:
    """One peer's. `incoming` gives the key of what the peer says under a salt, `may_derive` says at what time it may be asked for one;
    `token` draws challenges."""

    __slots__ = (
        "_answered",
        "_answered_at",
        "_challenge",
        "_challenged_at",
        "_dead",
        "_first_answered",
        "_held",
        "_incoming",
        "_key",
        "_may_derive",
        "_met",
        "_new_salt_at",
        "_outgoing",
        "_token",
        "_unproven",
        "_window",
        "counter",
    )

    def __init__(
        self,
        outgoing: DatagramKey,
        incoming: Callable[[bytes], DatagramKey],
        token: Callable[[int], bytes],
        may_derive: Callable[[float], bool],
        first_counter: int = 0,
    ) -> None:
        self._outgoing = outgoing
        self._incoming = incoming
        self._token = token
        self._may_derive = may_derive
        self.counter = first_counter
        """Of the next datagram; none below it is used with `outgoing` any more."""
        self._key: DatagramKey | None = None
        self._met: DatagramKey | None = None
        """Under the last salt that opened and does not count: no forgery keeps from us what else comes under it."""
        self._window = ReplayWindow()
        self._dead: deque[bytes] = deque(maxlen=DEAD_SALTS_MAX)
        self._held: deque[Held] = deque()
        self._challenge = b""
        self._challenged_at = -math.inf
        self._answered_at = -math.inf
        self._unproven: OrderedDict[bytes, Unproven] = OrderedDict()
        self._new_salt_at = -math.inf
        self._answered = (b"", -math.inf)
        self._first_answered: bytes | None = None if first_counter else b""
        """The one challenge that was answered under our salt; None: several, or an earlier pairing may have answered others."""

    def seal(self, packet: bytes) -> bytes:
        """The datagram that carries a packet to the peer."""
        return self._sealed(packed_packet(packet))

    def take(self, head: DatagramHead, data: bytes, now: float) -> Taken:
        """Judge a datagram that says that it is from this peer, for us."""
        taken = Taken()
        counts = self._key is not None and self._key.salt == head.salt
        if counts and not self._window.is_fresh(head.counter):
            return taken.drop(Drop.REPEATED, "it was there before")
        if head.salt in self._dead:
            return taken.drop(Drop.STALE, "it is of an earlier boot")
        key = self._key_under(head.salt, now)
        if key is None:
            return taken.drop(Drop.CROWDED, "too many come under unknown salts")
        try:
            content = unpacked(key.open(data))
        except DamagedData as problem:
            return taken.drop(Drop.FORGED, str(problem))
        if counts:
            self._window.accept(head.counter)
        else:
            self._met = key
        match content.kind:
            case Kind.PACKET if counts:
                taken.packets.append(content.packet)
            case Kind.PACKET:
                self._hold(Held(head.salt, head.counter, content.packet, now), taken)
                self._ask(taken, now)
            case Kind.CHALLENGE:
                if counts:
                    self._answer_proven(content.challenge, taken, now)
                else:
                    self._answer_unproven(head, content.challenge, taken, now)
            case Kind.ANSWER | Kind.FIRST_ANSWER:
                self._hear_answer(content, key, head.counter, taken, now, counts=counts)
                if content.challenge and self._key is key and not self._has_just_answered(content.challenge, now):
                    self._answer_proven(content.challenge, taken, now)
        return taken

    def _key_under(self, salt: bytes, now: float) -> DatagramKey | None:
        """None: nothing has opened under it lately, and no key may be derived now."""
        for known in (self._key, self._met):
            if known is not None and known.salt == salt:
                return known
        return self._incoming(salt) if self._may_derive(now) else None

    def _hear_answer(self, answer: Content, key: DatagramKey, counter: int, taken: Taken, now: float, *, counts: bool) -> None:
        if not self._challenge or answer.echo != self._challenge:
            taken.drop(Drop.UNASKED, "it answers no challenge of ours, or one that was answered")
            return
        if not counts:
            if self._key is not None:
                self._dead.append(self._key.salt)
            self._key, self._met = key, None
            # What the peer said before its answer may have been here in an earlier life of ours, but for what was held.
            self._window = ReplayWindow(0 if answer.kind is Kind.FIRST_ANSWER else counter)
            self._window.accept(counter)
        self._challenge = b""
        held, self._held = self._held, deque()
        for one in held:
            if one.salt == key.salt and not counts and now - one.at <= HOLD_S:
                # It may have overtaken the answer.
                self._window.accept(one.counter)
                taken.packets.append(one.packet)
            else:
                taken.drop(Drop.STALE, "it is of an earlier boot, or was held for too long")

    def _hold(self, packet: Held, taken: Taken) -> None:
        if any((one.salt, one.counter) == (packet.salt, packet.counter) for one in self._held):
            taken.drop(Drop.REPEATED, "it was there before")
            return
        if len(self._held) == HELD_MAX:
            self._held.popleft()
            taken.drop(Drop.CROWDED, "too many of this peer wait for the answer to a challenge")
        self._held.append(packet)

    def _ask(self, taken: Taken, now: float) -> None:
        if now - self._challenged_at >= CHALLENGE_S_MIN:
            self._challenged_at = now
            taken.replies.append(self._sealed(packed_challenge(self._own_challenge())))

    def _answer_proven(self, challenge: bytes, taken: Taken, now: float) -> None:
        if now - self._answered_at < ANSWER_S_MIN:
            taken.drop(Drop.CROWDED, "challenges come too often")
            return
        self._answered_at = now
        self._answer(challenge, taken, now, asks_back=False)

    def _answer_unproven(self, head: DatagramHead, challenge: bytes, taken: Taken, now: float) -> None:
        """Anybody may have recorded it: so it is answered once, and takes no answer from a challenge under another salt."""
        before = self._unproven.get(head.salt)
        if before is None:
            if len(self._unproven) >= UNPROVEN_SALTS_MAX:
                if now - self._new_salt_at < ANSWER_S_MIN:
                    taken.drop(Drop.CROWDED, "challenges come too often, under more salts than are remembered")
                    return
                self._unproven.popitem(last=False)
            self._new_salt_at = now
            before = self._unproven[head.salt] = Unproven()
        self._unproven.move_to_end(head.salt)
        if head.counter <= before.counter:
            taken.drop(Drop.REPEATED, "it was answered before, or a later one was")
            return
        if now - before.at < ANSWER_S_MIN:
            taken.drop(Drop.CROWDED, "challenges come too often")
            return
        before.counter, before.at = head.counter, now
        self._answer(challenge, taken, now, asks_back=True)

    def _answer(self, challenge: bytes, taken: Taken, now: float, *, asks_back: bool) -> None:
        self._answered = (challenge, now)
        is_first = self._first_answered in (b"", challenge)
        self._first_answered = challenge if is_first else None
        taken.replies.append(self._sealed(packed_answer(challenge, self._own_challenge() if asks_back else b"", first=is_first)))

    def _has_just_answered(self, challenge: bytes, now: float) -> bool:
        """Two that speak at the same moment challenge each other, and again in their answers: one answer is enough."""
        return self._answered[0] == challenge and now - self._answered[1] < ANSWER_S_MIN

    def _own_challenge(self) -> bytes:
        """The same until it is answered: an answer that was on its way for long counts, too."""
        self._challenge = self._challenge or self._token(CHALLENGE_BYTES)
        return self._challenge

    def _sealed(self, content: bytes) -> bytes:
        counter, self.counter = self.counter, self.counter + 1
        return self._outgoing.seal(counter, content)
