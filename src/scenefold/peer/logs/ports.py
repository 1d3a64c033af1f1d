"""What a log needs of the node that it runs on, and of whoever it belongs to."""

from __future__ import annotations

from typing import Protocol

from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.consensus import Decide, Judge, Learn, Message, Reply, Slot, Value
from scenefold.store.logs import NOTHING_BESIDE, Beside
from scenefold.wire import Member


class Carrier(Protocol):
    """The way to other nodes."""

    async def send(self, target: NodeId, message: Message, /, *more: Learn) -> None:
        """Return once it is on its way, which it may get lost on; Unreachable if the connection is refused, or broken.

        `more`: the positions behind a Learn, one after the other.
        """


class Surroundings(Protocol):
    """The world as this node sees it now. What must be right does not depend on it."""

    def line(self) -> tuple[NodeId, ...]:
        """Nodes in the order of the line."""

    def reachable(self) -> frozenset[NodeId]:
        """To whom packets can be sent."""

    def alive(self) -> frozenset[NodeId]:
        """Who is believed to be alive."""

    def is_gone(self, member: Member, /) -> bool:
        """Whether this incarnation of a node will never say anything again, as far as is known here, whoever lives in its place."""


class Owner:
    """Whose log it is, and what he does about it; by itself nothing. All of these return at once: what takes time he does elsewhere."""

    def veto(self, value: Value | None) -> RejectReason | None:
        """Why what is proposed does not suit this node now (specs/26-modes.md, The switch)."""
        return None

    def insisted(self, value: Value) -> None:
        """This is proposed whether it suits this node or not: somebody may have voted for it already, or whoever asked for it forces it."""

    def speaks(self) -> bool:
        """Whether this node may promise and vote at all; until then it learns. Who says otherwise than before calls the log's `restate`."""
        return True

    def abstains(self, value: Value) -> bool:
        """Whether this node must not vote for this yet."""
        return False

    def votes(self, value: Value) -> None:
        """This node is about to vote for this: it is durable, and seen, only after this returns. It may fail then.

        Refused if it must not vote for this now: then it does not, as if the disk had refused.
        """

    def stands(self, slot: Slot, *, is_silent: bool) -> None:
        """What is durable of the open position: at the start of the log's task, and after each try to write.

        `is_silent`: this node has forgotten what it said there, and says nothing.
        """

    def beside(self, decided: Decide, after: Judge) -> Beside:
        """What else is to be written in the transaction that makes this decided."""
        return NOTHING_BESIDE

    def leaner(self, value: Value) -> Value:
        """The value with as much of its body as has to be kept once the position behind it is decided, too."""
        return value

    def decided(self, decided: Decide, after: Judge) -> None:
        """It is decided, durably, and so is what was beside it."""

    def settled(self, reply: Reply) -> None:
        """What became of a value whose asker was told that it is unknown, or who waits no more."""
