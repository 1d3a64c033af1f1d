"""What of a log is durable, and how it changes (specs/10-store.md, Logs)."""

from __future__ import annotations

import logging
from dataclasses import replace

from scenefold.base.errors import DamagedData
from scenefold.consensus import Certificate, Decide, Judge, Persist, Setting, State
from scenefold.consensus.effects import Write
from scenefold.consensus.facts import belongs
from scenefold.peer.logs.ports import Owner
from scenefold.store import Store
from scenefold.store.log_rows import Decided, Votes
from scenefold.wire import Member, Phase, ProposalId

_NOBODY = bytes(16)
"""No incarnation: who speaks as this one takes part in nothing."""

_log = logging.getLogger("scenefold.peer.logs")


class Memory:
    """The rows of one log. Only its task writes."""

    def __init__(self, store: Store, setting: Setting, owner: Owner, silent_until: int = 0) -> None:
        assert setting.me.incarnation == store.identity.incarnation
        self._store, self._setting, self._owner = store, setting, owner
        self._silent_until = silent_until
        self._newest: Decided | None = None

    async def read(self, judge: Judge, position: int) -> State:
        """What is known after a start. `judge` knows all up to `position`."""
        genesis, incarnation = self._setting.genesis, self._setting.me.incarnation
        stored = await self._store.read_log(genesis, position)
        if stored is None:
            # From now on a log without votes is a damaged one.
            await self._store.put_votes(genesis, Votes(incarnation, position + 1))
            return State(judge, position)
        for what in stored.damage:
            _log.error("%s; this node does not vote in that log up to position %d", what, stored.silent_until)
        self._silent_until = stored.silent_until
        for decided in stored.tail:
            if judge.refuses(decided.value, is_decided=True) is not None:
                where = f"log {genesis[:8].hex()}, position {decided.position}"
                raise DamagedData("what was decided makes no sense there", where=where, remedy="see to the disk, then wipe the folder")
            judge = judge.after(decided.value)
        self._newest = stored.tail[-1] if stored.tail else None
        return State(judge, position + len(stored.tail), stored.slot)

    def setting(self, state: State) -> Setting:
        """As whom this node speaks of the open position: as nobody, where it may have said something that it has forgotten."""
        if state.position >= self._silent_until:
            return self._setting
        return replace(self._setting, me=Member(self._setting.me.node, _NOBODY))

    async def write(self, write: Write, before: State, after: State) -> None:
        """Make it durable; Refused if it cannot be."""
        genesis, incarnation = self._setting.genesis, self._setting.me.incarnation
        if isinstance(write, Persist):
            accepted = write.slot.accepted
            if accepted is not None and accepted != before.slot.accepted:
                self._owner.votes(accepted.value)
            await self._store.put_votes(genesis, Votes(incarnation, before.position + 1, write.slot, self._silent_until))
            return
        decided = Decided(write.position, write.value, _lean(write))
        votes = Votes(incarnation, write.position + 1, silent_until=self._silent_until)
        await self._store.put_decided(genesis, (*self._leaner(), decided), votes, self._owner.beside(write, after.judge))
        self._newest = decided

    def _leaner(self) -> tuple[Decided, ...]:
        """The position before, if less of its value needs to be kept now."""
        if self._newest is None:
            return ()
        value = self._newest.value
        lean = self._owner.leaner(value)
        return () if lean.body == value.body else (self._newest._replace(value=lean),)


def _lean(decide: Decide) -> Certificate:
    """The certificate without whatever else came with it."""
    proof = decide.certificate
    proposal = ProposalId(proof.position, proof.ballot, Phase.ACCEPT)
    return replace(proof, votes=tuple(vote for vote in proof.votes if belongs(vote, proposal, decide.value.digest)))
