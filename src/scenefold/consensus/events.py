"""What may happen to a log at a node, and what the node knows of the world at that moment (specs/25-consensus.md)."""

from __future__ import annotations

from dataclasses import dataclass, field

from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.consensus.messages import Message
from scenefold.consensus.routes import Route
from scenefold.consensus.timing import Timer
from scenefold.consensus.values import Value


@dataclass(frozen=True, slots=True)
class Started:
    """The node has read its disk."""


@dataclass(frozen=True, slots=True)
class Ask:
    """Somebody wants this to be decided; without a value: wants to know what may have been begun (a barrier)."""

    value: Value | None
    deadline: float
    is_for_all: bool = False
    """Whoever seems alive has to agree, as far as nothing has begun yet."""
    is_forced: bool = False
    """Nobody is asked whether it suits him."""
    needs_consent: bool = True
    """Others may have something against it (specs/26-modes.md), so they are heard before anybody votes. False: nobody can have."""


@dataclass(frozen=True, slots=True)
class Received:
    """`sender`: whoever has handed it on, not who wrote it."""

    sender: NodeId
    message: Message


@dataclass(frozen=True, slots=True)
class TimeOver:
    timer: Timer


@dataclass(frozen=True, slots=True)
class Lost:
    """A connection to a node is refused or broken: what was sent to it may not have come."""

    node: NodeId


Event = Started | Ask | Received | TimeOver | Lost


@dataclass(frozen=True, slots=True)
class View:
    """What the world looks like from this node when something happens. What must be right does not depend on it."""

    now: float
    line: Route
    """Nodes in the order of the line."""
    reachable: frozenset[NodeId]
    """To whom packets can be sent."""
    alive: frozenset[NodeId]
    """Who is believed to be alive."""
    can_write: bool = True
    """False: the disk has refused this very event. The node then takes no part in it, and hands on what others say."""
    veto: RejectReason | None = field(default=None)
    """Why what is proposed does not suit this node now; asked in the first phase only, as a vote cannot be taken back."""
    abstains: bool = False
    """This node must not vote for what is proposed yet. It says nothing, and hands it on."""
