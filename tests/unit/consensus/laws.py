"""What must hold after every step of every node (specs/25-consensus.md, What holds), watched from outside.

`Broken` is raised where a law does not hold. A vote counts as cast when it is on a disk, whoever learns of it.
"""

from __future__ import annotations

from collections import defaultdict

from scenefold.consensus import Certificate, Decide, Outcome, Participants, Persist, Reply, Slot, Value
from scenefold.consensus.ballots import NO_BALLOT
from scenefold.wire import Ballot, Member
from unit.consensus.logs_made import Book, request_of


class Broken(AssertionError):
    """A law does not hold."""


class Laws:
    def __init__(self, first: Book) -> None:
        self.votes: dict[tuple[int, Ballot, bytes], set[Member]] = defaultdict(set)
        self.values: dict[tuple[int, Ballot], bytes] = {}
        self.promised: dict[tuple[Member, int], Ballot] = {}
        self.chosen: dict[int, bytes] = {}
        self.decided: dict[int, Value] = {}
        self.deciders: dict[int, Participants] = {1: first.participants}
        self.rejected: set[bytes] = set()
        self.holding: dict[int, set[Member]] = defaultdict(set)
        """Who has the chosen value of a position on its disk, accepted or decided; it never stops to."""
        self.watches_disks = True
        """False: only what comes of it is judged (two values decided, say), not that a disk forgets."""
        self.gone: set[Member] = set()
        """Incarnations that lost their disk: they hold nothing, and never vote again."""

    def wrote(self, who: Member, position: int, write: Persist | Decide, judge: Book) -> None:
        """A node has written; `position`: the one that was open there."""
        if isinstance(write, Persist):
            self._slot(who, position, write.slot)
            return
        self.decide(write.position, write.value, judge)
        self._certified(who, write.position, write.value, write.certificate)
        known = self.chosen.get(write.position)
        self._hold(known is not None, f"position {write.position} is decided at {who.node}, and nothing was chosen there")
        self._hold(known == write.value.digest, f"position {write.position}: decided at {who.node} is another value than the chosen one")
        if who in self.deciders[write.position]:
            self.holding[write.position].add(who)

    def decide(self, position: int, value: Value, after: Book) -> None:
        """I1, and with it I3; I5, and at most one entry of a request."""
        known = self.decided.setdefault(position, value)
        self._hold(known == value, f"I1: position {position} is decided twice")
        self.deciders.setdefault(position + 1, after.participants)
        self._hold(value.digest not in self.rejected, f"I5: what was rejected is decided at {position}")
        requests = [request_of(other) for at, other in self.decided.items() if at != position]
        self._hold(request_of(value) not in requests, "a request is in the log twice")

    def replied(self, reply: Reply) -> None:
        if reply.digest is None:
            return
        values = {value.digest for value in self.decided.values()}
        if reply.outcome is Outcome.REJECTED:
            self._hold(reply.digest not in values, f"I5: rejected, and decided at {reply.position}")
            self.rejected.add(reply.digest)
        if reply.outcome is Outcome.COMMITTED:
            self._hold(reply.position in self.decided, "committed, and decided nowhere")

    def restarted(self, who: Member, position: int, slot: Slot) -> None:
        """I4 and I2 across a restart: what a node has on its disk then is what it said."""
        if not self.watches_disks:
            return
        self._slot(who, position, slot)
        if position in self.chosen and who in self.holding[position]:
            held = slot.accepted_digest == self.chosen[position]
            self._hold(held, f"I2: {who.node} has forgotten the chosen value of {position}")

    def wiped(self, who: Member) -> None:
        self.gone.add(who)

    def _slot(self, who: Member, position: int, slot: Slot) -> None:
        before = self.promised.get((who, position), NO_BALLOT)
        self._hold(slot.promised >= before or not self.watches_disks, f"I4: {who.node} promised {before}, and now {slot.promised}")
        self.promised[who, position] = slot.promised
        if slot.accepted is None:
            return
        ballot, digest = slot.accepted.ballot, slot.accepted.value.digest
        self._hold(self.values.setdefault((position, ballot), digest) == digest, f"I4: two values in {ballot} at {position}")
        self._hold(position in self.deciders, f"{who.node} votes at {position}, and nothing is decided before it")
        if who not in self.deciders[position]:
            raise Broken(f"{who} votes at {position}, and takes no part there")
        voters = self.votes[position, ballot, digest]
        voters.add(who)
        if len(voters) >= self._majority(position):
            known = self.chosen.setdefault(position, digest)
            self._hold(known == digest, f"I1: two values are chosen at {position}")
            self.holding[position] |= voters
        if self.chosen.get(position) == digest:
            self.holding[position].add(who)
        elif position in self.chosen and who in self.holding[position] and self.watches_disks:
            raise Broken(f"I2: {who.node} gives up the chosen value of {position}")

    def _certified(self, who: Member, position: int, value: Value, certificate: Certificate) -> None:
        """I6, by what is known to have been voted."""
        voters = self.votes[position, certificate.ballot, value.digest]
        named = {vote.member for vote in certificate.votes}
        enough = len(named) >= self._majority(position)
        # A voter may decide in the very step in which it votes: then its vote was never on a disk of itself.
        self._hold(named - voters <= {who}, f"I6: a certificate of {position} names {named - voters}, who never voted")
        self._hold(enough and certificate.position == position, f"I6: too few votes for {position}")
        self.votes[position, certificate.ballot, value.digest] = voters | named
        first = self.values.setdefault((position, certificate.ballot), value.digest)
        self._hold(first == value.digest, f"I6: the certificate of {position} is for another value than its ballot")
        known = self.chosen.setdefault(position, value.digest)
        self._hold(known == value.digest, f"I1: two values are chosen at {position}")
        self.holding[position] |= named

    def _majority(self, position: int) -> int:
        """By its own reckoning: not by that of the code that is tried here."""
        return len(self.deciders[position].everyone) // 2 + 1

    def _hold(self, holds: bool, law: str) -> None:
        if not holds:
            raise Broken(law)
