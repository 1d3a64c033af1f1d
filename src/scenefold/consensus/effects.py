"""What a step wants done, in this order (specs/25-consensus.md, What is durable).

Rule D, that nothing is shown before it is durable, is the shape of a `Step`: at most one of its effects writes, and that one
stands first. Whoever carries out effects one after the other, and stops at one that fails, keeps the rule without knowing it.
If the write fails, the step has not happened: the state before it stands, and the same event is tried again with
`View.can_write` false.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Generic, TypeVar

from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.consensus.certificates import Certificate
from scenefold.consensus.messages import Message
from scenefold.consensus.slots import Slot
from scenefold.consensus.timing import Timer
from scenefold.consensus.values import Value


@dataclass(frozen=True, slots=True)
class Persist:
    """Make this durable as the open position's slot."""

    slot: Slot


@dataclass(frozen=True, slots=True)
class Decide:
    """Make this durable as the next of what is decided, and the slot empty, in one transaction."""

    position: int
    value: Value
    certificate: Certificate


@dataclass(frozen=True, slots=True)
class Send:
    target: NodeId
    message: Message


@dataclass(frozen=True, slots=True)
class Tell:
    """Send a node what is decided above a position."""

    target: NodeId
    above: int


@dataclass(frozen=True, slots=True)
class SetTimer:
    """`TimeOver(timer)` is to happen after a time that the shell draws between these bounds; one set earlier is forgotten."""

    timer: Timer
    least_s: float
    most_s: float


class Outcome(Enum):
    """What whoever has asked is told."""

    COMMITTED = "decided at this position"
    REJECTED = "this node has put it into no ACCEPT, or another value is decided at this position"
    UNKNOWN = "it was in an ACCEPT, and it is not known what is decided"
    OPEN = "of a barrier: a majority has promised, and none of it has voted for anything"


@dataclass(frozen=True, slots=True)
class Reply:
    """`digest`: of the value that was asked for, None after a barrier. `reason`, `by`: why it was rejected, and by whom."""

    digest: bytes | None
    outcome: Outcome
    position: int
    reason: RejectReason | None = None
    by: NodeId | None = None


Write = Persist | Decide
Effect = Persist | Decide | Send | Tell | SetTimer | Reply
After = TypeVar("After")


@dataclass(frozen=True, slots=True)
class Step(Generic[After]):
    """The state after an event, and what is to be done."""

    after: After
    effects: tuple[Effect, ...]

    def __post_init__(self) -> None:
        assert not any(isinstance(effect, Write) for effect in self.effects[1:]), "a step writes first, and once"

    @property
    def write(self) -> Write | None:
        """What has to be durable before anything else of this step is done."""
        first = self.effects[0] if self.effects else None
        return first if isinstance(first, Write) else None
