"""A log as simple as can be, and keys that cost nothing, for tests of the protocol alone."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, field, replace
from functools import lru_cache

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.consensus import Participant, Participants, Value
from scenefold.wire import Member

GENESIS = bytes(range(32))


@dataclass(frozen=True)
class Key:
    """Signs and checks. A signature is a hash of whose it is and what it is for: nobody in these tests makes one that is not his own."""

    raw: bytes

    def sign(self, domain: bytes, message: bytes) -> bytes:
        return hashlib.sha256(self.raw + domain + message).digest()

    def verify(self, signature: bytes, domain: bytes, message: bytes) -> None:
        if signature != self.sign(domain, message):
            raise DamagedData("forged")


@lru_cache(None)
def member(node: int, life: int = 0) -> Member:
    return Member(NodeId(node), life.to_bytes(16, "big"))


@lru_cache(None)
def key_of(who: Member) -> Key:
    return Key(b"%d:%b" % (who.node, who.incarnation))


def participant(who: Member) -> Participant:
    return Participant(who, key_of(who))


def participants(*nodes: int) -> Participants:
    return Participants(tuple(participant(member(node)) for node in nodes))


@dataclass(frozen=True)
class Change:
    """Who joins or leaves with a value."""

    joins: Member | None = None
    leaves: Member | None = None


NOTHING = Change()


@dataclass(frozen=True)
class Book:
    """The judge: a chain of values, each of which is one request, and may change who takes part."""

    participants: Participants
    position: int = 0
    head: str = ""
    requests: dict[str, int] = field(default_factory=dict, hash=False)

    def value(self, request: str, origin: int, change: Change = NOTHING) -> Value:
        """What to propose here so that a request is done."""
        who = change.joins or change.leaves
        what = None if who is None else [change.joins is not None, int(who.node), who.incarnation.hex()]
        return Value(json.dumps([self.position + 1, self.head, request, origin, what]).encode())

    def refuses(self, value: Value, *, is_decided: bool = False) -> RejectReason | None:
        position, head, request, _, _ = json.loads(value.data)
        if (position, head) != (self.position + 1, self.head) or request in self.requests:
            return RejectReason.ILL_FORMED
        try:
            self._participants_after(value)
        except Refused as refused:
            return refused.reason
        return None

    def found(self, value: Value) -> int | None:
        return self.requests.get(request_of(value))

    def after(self, value: Value) -> Book:
        assert self.refuses(value, is_decided=True) is None
        requests = {**self.requests, request_of(value): self.position + 1}
        return replace(
            self,
            participants=self._participants_after(value),
            position=self.position + 1,
            head=value.digest.hex(),
            requests=requests,
        )

    def _participants_after(self, value: Value) -> Participants:
        what = json.loads(value.data)[4]
        if what is None:
            return self.participants
        who = Member(NodeId(what[1]), bytes.fromhex(what[2]))
        return self.participants.joined_by(participant(who)) if what[0] else self.participants.left_by(who)


def request_of(value: Value) -> str:
    return str(json.loads(value.data)[2])
