"""What a node keeps durably of the position that it has open (specs/25-consensus.md, What is durable)."""

from __future__ import annotations

from dataclasses import dataclass, replace

from scenefold.consensus.ballots import NO_BALLOT
from scenefold.consensus.values import NO_DIGEST, Value
from scenefold.wire import Ballot


@dataclass(frozen=True, slots=True)
class Tentative:
    """A value that this node has voted for, and the newest ballot in which it did."""

    ballot: Ballot
    value: Value


@dataclass(frozen=True, slots=True)
class Slot:
    """Of position c + 1; `Slot()` as soon as that is another one."""

    promised: Ballot = NO_BALLOT
    accepted: Tentative | None = None
    exposed: frozenset[bytes] = frozenset()
    """Digests of values that were asked for here and that this node has put into an ACCEPT: of these it does not say that they never will be."""

    def promise(self, ballot: Ballot) -> Slot:
        assert ballot >= self.promised, "a promise is kept"
        return replace(self, promised=ballot)

    def vote(self, ballot: Ballot, value: Value) -> Slot:
        assert ballot >= self.promised, "a promise is kept"
        assert self.accepted is None or self.accepted.ballot < ballot or self.accepted.value == value, "a ballot has one value"
        return replace(self, promised=ballot, accepted=Tentative(ballot, value))

    def expose(self, value: Value) -> Slot:
        return replace(self, exposed=self.exposed | {value.digest})

    @property
    def accepted_ballot(self) -> Ballot:
        return NO_BALLOT if self.accepted is None else self.accepted.ballot

    @property
    def accepted_digest(self) -> bytes:
        return NO_DIGEST if self.accepted is None else self.accepted.value.digest
