"""`python -m integration.dying_node`: a node that dies, as by `kill -9`, at a point of a proposal for a scene's log (specs/25-consensus.md, On a node).

SCENEFOLD_DIES_AT names a folder. While there is a file in it that bears the node's address, the node dies as soon as a proposal reaches the
point that the file names, in a first ballot or in a later one, as it says. Nodes as users run them know nothing of this: what is put between a log and its node lies here alone.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import trio

from scenefold.base.ids import NodeId
from scenefold.consensus import Learn, Message, Outcome, Propose, Slot
from scenefold.node.program import main
from scenefold.peer.logs import Answer, Log, open_log
from scenefold.peer.scene_log import scene_run
from scenefold.store.log_rows import Decided, StoredLog, Votes
from scenefold.wire import Ballot, Phase

VARIABLE = "SCENEFOLD_DIES_AT"
ORIGINATOR = (
    "promised",
    "prepare-left",
    "majority-promised",
    "voted",
    "accept-left",
    "majority-voted",
    "decided",
    "one-told",
    "all-told",
)
PARTICIPANT = ("other-promised", "other-voted", "other-learnt")
WITH_PROMISES = ("promised", "prepare-left", "majority-promised", "other-promised")
"""A first ballot has none of these."""


def doom(point: str, *, in_first: bool) -> str:
    """What the file says."""
    return f"{point}, {'first' if in_first else 'later'} ballot"


class Points:
    """Where this process is to die, by the file that says so."""

    def __init__(self, file: Path) -> None:
        self._file = file

    def is_at(self, point: str, ballot: Ballot) -> bool:
        """Whether this is the point."""
        try:
            return self._file.read_text() == doom(point, in_first=ballot.counter == 0)
        except FileNotFoundError:
            return False

    def reach(self, point: str, ballot: Ballot) -> None:
        if self.is_at(point, ballot):
            os.kill(os.getpid(), signal.SIGKILL)


class DyingStore:
    """A store, as one log uses it."""

    def __init__(self, store: Any, me: NodeId, points: Points) -> None:
        self._store, self._me, self._points = store, me, points
        self._slot = Slot()
        """Of the open position, as it lies on the disk."""
        self.decided_now: dict[int, Ballot] = {}
        """What this process has brought to a decision itself, and in which ballot."""

    def __getattr__(self, name: str) -> Any:
        return getattr(self._store, name)

    async def read_log(self, *arguments: Any) -> StoredLog | None:
        stored: StoredLog | None = await self._store.read_log(*arguments)
        self._slot = Slot() if stored is None else stored.slot
        return stored

    async def put_votes(self, genesis: bytes, votes: Votes, *more: Any) -> None:
        slot, was = votes.slot, self._slot
        has_voted, has_promised = slot.accepted_ballot != was.accepted_ballot, slot.promised != was.promised
        is_own = slot.promised.node == self._me
        if has_voted and is_own:
            self._points.reach("majority-promised", slot.promised)
        await self._store.put_votes(genesis, votes, *more)
        self._slot = slot
        if has_voted:
            self._points.reach("voted" if is_own else "other-voted", slot.accepted_ballot)
        elif has_promised:
            self._points.reach("promised" if is_own else "other-promised", slot.promised)

    async def put_decided(self, genesis: bytes, decided: Sequence[Decided], votes: Votes, *more: Any) -> None:
        ballot = decided[-1].certificate.ballot
        is_own = ballot.node == self._me
        if is_own:
            self._points.reach("majority-voted", ballot)
            self.decided_now[decided[-1].position] = ballot
        await self._store.put_decided(genesis, decided, votes, *more)
        self._slot = votes.slot
        self._points.reach("decided" if is_own else "other-learnt", ballot)


class DyingCarrier:
    """The way to other nodes. `others`: those that are told of a decision."""

    def __init__(self, carrier: Any, me: NodeId, others: int, store: DyingStore, points: Points) -> None:
        self._carrier, self._me, self._others, self._store, self._points = carrier, me, others, store, points
        self._told: dict[int, set[NodeId]] = {}
        self._news = trio.Event()

    async def send(self, target: NodeId, message: Message, /, *more: Learn) -> None:
        await self._carrier.send(target, message, *more)
        if isinstance(message, Propose) and message.proposal.ballot.node == self._me:
            point = "prepare-left" if message.proposal.phase is Phase.PREPARE else "accept-left"
            self._points.reach(point, message.proposal.ballot)
        for learn in (message, *more):
            if isinstance(learn, Learn) and learn.position in self._store.decided_now:
                self._points.reach("one-told", self._store.decided_now[learn.position])
                self._told.setdefault(learn.position, set()).add(target)
                self._news.set()

    async def all_told(self, position: int) -> None:
        while len(self._told.get(position, ())) < self._others:
            self._news = trio.Event()
            await self._news.wait()


def dying(points: Points) -> Any:
    """`open_log`, with all that comes of it by way of the points."""

    async def open_to_die(
        world: Any, store: Any, setting: Any, judge: Any, carrier: Any, around: Any, owner: Any = None, *, position: int = 0
    ) -> Log:
        me, others = setting.me.node, len(judge.participants.nodes - {setting.me.node})
        mortal = DyingStore(store, me, points)
        messenger = DyingCarrier(carrier, me, others, mortal, points)
        log: Any = await open_log(world, mortal, setting, judge, messenger, around, owner, position=position)  # type: ignore[arg-type]
        ask = log.ask

        async def asked(*arguments: Any, **options: Any) -> Answer:
            answer: Answer = await ask(*arguments, **options)
            ballot = mortal.decided_now.get(answer.position)
            if ballot is not None and answer.outcome is Outcome.COMMITTED and points.is_at("all-told", ballot):
                await messenger.all_told(answer.position)
                points.reach("all-told", ballot)
            return answer

        log.ask = asked
        return log  # type: ignore[no-any-return]

    return open_to_die


if __name__ == "__main__":
    folder = os.environ.get(VARIABLE)
    if folder is not None:
        address = sys.argv[sys.argv.index("--address") + 1]
        patched: Any = scene_run
        patched.open_log = dying(Points(Path(folder) / address))
    sys.exit(main())
