"""What a node knows of the deciding of one log (specs/25-consensus.md). Immutable; of it position, judge and slot come from the disk."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.consensus.facts import Fact
from scenefold.consensus.participants import Signs
from scenefold.consensus.routes import Route
from scenefold.consensus.slots import Slot
from scenefold.consensus.timing import Timing
from scenefold.consensus.values import Judge, Value
from scenefold.wire import Ballot, Member, ProposalId

NEVER = float("-inf")


@dataclass(frozen=True, slots=True)
class Setting:
    """What does not change while the node runs."""

    genesis: bytes
    me: Member
    key: Signs
    timing: Timing = field(default_factory=Timing)
    at_once_bytes: int = 0
    """So many bytes of values a pass may take away from this node to go straight to everybody; more of them go by the arms."""


class Stage(Enum):
    """Where a proposal stands."""

    IDLE = "idle"
    PREPARING = "preparing"
    SEEKING = "seeking"
    ACCEPTING = "accepting"
    REPEATING = "repeating"
    RESTING = "resting"


@dataclass(frozen=True, slots=True)
class Proposal:
    """What this node tries to get decided at position c + 1. Nothing of it is durable but what its own slot says."""

    stage: Stage = Stage.IDLE
    wish: Value | None = None
    """What was asked for, or is taken over."""
    is_asked: bool = False
    """Somebody waits for the outcome."""
    is_for_all: bool = False
    is_forced: bool = False
    needs_consent: bool = True
    """Others may have something against it: all that can answer are heard before anybody votes."""
    deadline: float = NEVER
    met: Ballot | None = None
    """The highest ballot that somebody has refused this one for."""
    reason: RejectReason = RejectReason.NO_MAJORITY
    """Why the newest ballot came to nothing, and who said so."""
    by: NodeId | None = None
    before: tuple[RejectReason, NodeId | None] = (RejectReason.NO_MAJORITY, None)
    """The same of the ballot before that."""
    has_voted: bool = False
    """In one of its ballots a majority had promised, and there was something to vote for."""
    is_behind: bool = False
    """Somebody has refused a ballot since the position is decided, and has not told yet with which value."""
    # Of the present ballot:
    id: ProposalId | None = None
    route: Route = ()
    arms: frozenset[NodeId] = frozenset()
    """First hops that have not answered yet."""
    facts: tuple[Fact, ...] = ()
    values: tuple[Value, ...] = ()
    """Those that promises name, as far as they were met."""
    chosen: Value | None = None

    @property
    def digest(self) -> bytes | None:
        return None if self.wish is None else self.wish.digest

    @property
    def has_met_something(self) -> bool:
        """Whoever only looked cannot be told any more that there is nothing: it has voted for something, or the position is decided."""
        return self.has_voted or self.is_behind

    @property
    def noted(self) -> tuple[RejectReason, NodeId | None]:
        """What was remembered of the newest ballot, while that is under way of the one before."""
        is_known = self.stage is Stage.RESTING or self.reason is not RejectReason.NO_MAJORITY
        return (self.reason, self.by) if is_known else self.before


IDLE = Proposal()


@dataclass(frozen=True, slots=True)
class Hop:
    """A proposal of somebody else's that was handed on, and what was known when it was."""

    proposal: ProposalId
    digest: bytes
    upstream: NodeId
    downstream: NodeId
    route: Route
    facts: tuple[Fact, ...]
    value: Value | None
    """In the first phase the one of the highest ballot that is named, in the second the one that is voted for."""
    is_waiting: bool = True
    """Nothing has come back yet."""


@dataclass(frozen=True, slots=True)
class State:
    judge: Judge
    position: int = 0
    """The newest that is decided here. The one after it is open, and no other."""
    slot: Slot = field(default_factory=Slot)
    proposal: Proposal = IDLE
    tries: int = 0
    """Ballots of this node for the open position that came to nothing, whoever asked for what: so many others want it, too."""
    hops: tuple[Hop, ...] = ()
    """The newest last."""
    heard_at: float = NEVER
    """When somebody last said something of the open position that he may say."""
    orphaned: Ballot | None = None
    """The ballot that this node has voted in, if the link to its node was lost since."""
    asked_at: float = NEVER
    """When this node last asked a participant for what is decided."""
    asked_others_at: float = NEVER
    """The same of others."""
