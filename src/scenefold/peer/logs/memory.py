"""What of a log is durable, and how it changes (specs/10-store.md, Logs)."""

from __future__ import annotations

import logging
from dataclasses import replace

from scenefold.base.errors import DamagedData
from scenefold.base.ids import NodeId
from scenefold.consensus import Certificate, Decide, Judge, Participants, Persist, Setting, State, Vote
from scenefold.consensus.effects import Write
from scenefold.consensus.facts import belongs, signed
from scenefold.consensus.values import NO_DIGEST
from scenefold.peer.logs.ports import Owner
from scenefold.store import Store
from scenefold.store.log_rows import Decided, Votes
from scenefold.wire import Ballot, Member, Phase, ProposalId

_NOBODY = bytes(16)
"""No incarnation: who speaks as this one takes part in nothing."""

_log = logging.getLogger("scenefold.peer.logs")


class Memory:
    """The rows of one log. Only its task writes."""

    def __init__(self, store: Store, setting: Setting, owner: Owner, silent_until: int = 0) -> None:
        assert setting.me.incarnation == store.identity.incarnation
        self._store, self._setting, self._owner = store, setting, owner
        self._silent_until = silent_until
        self._to_write: tuple[Decided, ...] = ()
        """The newest position as it is to be kept once the next one is decided, if that is less than it is kept with now."""
        self._known_by: tuple[Participants, bool] | None = None

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
        newest = stored.tail or await self._store.decided(genesis, position - 1, 1, 0) if position else stored.tail
        self._to_write = self._leaner(newest[-1]) if newest else ()
        return State(judge, position + len(stored.tail), stored.slot)

    def setting(self, state: State) -> Setting:
        """As whom this node speaks of the open position: as nobody, where it may have said something that it has forgotten, where nobody
        takes what it signs for its own, or as long as its owner says so."""
        if self._owner.speaks() and state.position >= self._silent_until and self._is_known_in(state.judge.participants):
            return self._setting
        return replace(self._setting, me=Member(self._setting.me.node, _NOBODY))

    def _is_known_in(self, participants: Participants) -> bool:
        if self._known_by is None or self._known_by[0] is not participants:
            self._known_by = participants, self._has_key_in(participants)
        return self._known_by[1]

    def _has_key_in(self, participants: Participants) -> bool:
        """Whether this node signs with the key that is known there: it may have another one since."""
        known, plain = participants.key_of(self._setting.me), Vote(1, Ballot(0, NodeId(0)), NO_DIGEST, self._setting.me)
        try:
            if known is not None:
                known.verify(signed(plain, bytes(32), self._setting.key).signature, Vote.DOMAIN, plain.signable(bytes(32)))
        except DamagedData:
            return False
        return True

    async def write(self, write: Write, before: State, after: State) -> None:
        """Make it durable; Refused if it cannot be."""
        genesis, incarnation = self._setting.genesis, self._setting.me.incarnation
        if isinstance(write, Persist):
            accepted = write.slot.accepted
            if accepted is not None and accepted != before.slot.accepted:
                self._owner.votes(accepted.value)
            await self._store.put_votes(genesis, Votes(incarnation, before.position + 1, write.slot, self._silent_until))
            return
        if self._is_cast_now(write, before):
            self._owner.votes(write.value)
        decided = Decided(write.position, write.value, _lean(write))
        votes = Votes(incarnation, write.position + 1, silent_until=self._silent_until)
        await self._store.put_decided(genesis, (*self._to_write, decided), votes, self._owner.beside(write, after.judge))
        self._to_write = self._leaner(decided)

    def _is_cast_now(self, write: Decide, before: State) -> bool:
        """Whether this node's own vote, which was never written, is what makes it decided."""
        own = (vote for vote in write.certificate.votes if vote.member == self._setting.me)
        return any(vote.ballot > before.slot.accepted_ballot for vote in own)

    def _leaner(self, decided: Decided) -> tuple[Decided, ...]:
        """With less of its value, if less needs to be kept later. The whole one may be megabytes, and a node may run hundreds of logs."""
        lean = self._owner.leaner(decided.value)
        return () if lean.body == decided.value.body else (decided._replace(value=lean),)


def _lean(decide: Decide) -> Certificate:
    """The certificate without whatever else came with it."""
    proof = decide.certificate
    proposal = ProposalId(proof.position, proof.ballot, Phase.ACCEPT)
    return replace(proof, votes=tuple(vote for vote in proof.votes if belongs(vote, proposal, decide.value.digest)))
