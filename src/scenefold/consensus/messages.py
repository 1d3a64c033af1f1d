"""What nodes say to one another, as values; packets 5 to 9 carry them (specs/25-consensus.md, Packets)."""

from __future__ import annotations

from dataclasses import dataclass, field

from scenefold.base.ids import NodeId
from scenefold.consensus.certificates import Certificate
from scenefold.consensus.facts import Fact, Refusal
from scenefold.consensus.values import NO_DIGEST, Value
from scenefold.wire import ProposalId


@dataclass(frozen=True, slots=True)
class AskLog:
    """5: what is decided above a position?"""

    genesis: bytes
    have: int


@dataclass(frozen=True, slots=True)
class Learn:
    """6: this is decided."""

    genesis: bytes
    position: int
    value: Value
    certificate: Certificate


@dataclass(frozen=True, slots=True)
class Propose:
    """7, on its way from the originator outward. It holds a fact of the originator itself, of this very ballot: without that one it is
    nobody's proposal."""

    genesis: bytes
    proposal: ProposalId
    route: tuple[NodeId, ...]
    """All participants in the order of the line, the originator among them."""
    facts: tuple[Fact, ...]
    highest: Value | None = None
    """In the first phase: the value of the highest ballot that one of the facts names."""
    value: Value | None = None
    """In the first phase: the one that is asked for, so that it can be refused while nothing has happened yet. In the second: what is voted for."""
    takeover: bool = False
    """It is to bring to an end what may have begun. Nobody is asked any more whether it suits him."""

    @property
    def digest(self) -> bytes:
        return NO_DIGEST if self.value is None else self.value.digest


@dataclass(frozen=True, slots=True)
class Accepted:
    """8, on its way back to the originator."""

    genesis: bytes
    proposal: ProposalId
    digest: bytes
    facts: tuple[Fact, ...]
    highest: Value | None = None


@dataclass(frozen=True, slots=True)
class Rejected:
    """9, likewise: an arm that ends here, and why. What it had collected so far is as true as ever."""

    genesis: bytes
    proposal: ProposalId
    digest: bytes
    refusal: Refusal
    facts: tuple[Fact, ...] = field(default=())


Answer = Accepted | Rejected
Message = AskLog | Learn | Propose | Accepted | Rejected
