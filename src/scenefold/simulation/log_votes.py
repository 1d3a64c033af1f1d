"""What participants have on their disks of the position that is open, and what certificates make of it (specs/17-simulation.md, Logs). Pure.

A vote counts as cast when it is on its voter's disk, whoever learns of it: so what is chosen, and what a certificate may name, is known here
before anybody else knows it. Who decides a position is told from what was decided before; majorities are reckoned by a rule of its own.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Mapping
from typing import NamedTuple

from scenefold.consensus.ballots import NO_BALLOT
from scenefold.simulation import laws
from scenefold.simulation.log_history import Wrong
from scenefold.wire import Ballot, Member


class Paper(NamedTuple):
    """What one participant has promised and voted for at a position. `accepted` None: for nothing."""

    position: int
    promised: Ballot
    accepted: tuple[Ballot, bytes] | None = None


class Voting:
    """All positions of one log."""

    def __init__(self) -> None:
        self.deciders: dict[int, frozenset[Member]] = {}
        """Who decides a position, where that is known."""
        self.taken_over = 0
        """Positions that were decided in a ballot of somebody else than the one who proposed the value first."""
        self._papers: dict[Member, Paper] = {}
        self._values: dict[tuple[int, Ballot], bytes] = {}
        self._voters = defaultdict[tuple[int, Ballot], set[Member]](set)
        self._first: dict[tuple[int, bytes], Ballot] = {}
        self._chosen: dict[int, bytes] = {}
        self._certified: dict[int, Ballot] = {}

    @property
    def chosen(self) -> Mapping[int, bytes]:
        """The value that a majority has voted for in one ballot."""
        return self._chosen

    def wrote(self, member: Member, paper: Paper) -> list[Wrong]:
        """A participant's disk has this now."""
        before = self._papers.get(member)
        self._papers[member] = paper
        wrong = []
        if before is not None and paper.position < before.position:
            wrong.append(Wrong(laws.PROMISES, f"{_name(member)} votes at {paper.position}, and was at {before.position}"))
        if before is not None and paper.position == before.position:
            wrong += _broken(member, before, paper)
        if paper.accepted is not None:
            ballot, digest = paper.accepted
            wrong += self._votes(member, paper.position, ballot, digest)
        return wrong

    def put_back(self, member: Member, paper: Paper) -> list[Wrong]:
        """The same of a disk that is a backup of what it was: who goes by that has forgotten votes, and is to say nothing."""
        if paper.promised == NO_BALLOT and paper.accepted is None:
            return []
        return [Wrong(laws.PROMISES, f"{_name(member)} takes part at position {paper.position}, and its disk was put back")]

    def certified(self, where: Member, position: int, ballot: Ballot, digest: bytes, voters: Collection[Member]) -> list[Wrong]:
        """A certificate lies on a node's disk. Who decides in the very step in which it votes has no vote of its own on its disk."""
        wrong = []
        strangers = set(voters) - self._voters[position, ballot] - {where}
        if strangers:
            names = ", ".join(sorted(map(_name, strangers)))
            wrong.append(Wrong(laws.CERTIFIED, f"a certificate of position {position} names {names}: no such vote was ever on that disk"))
        for member in voters:
            wrong += self._votes(member, position, ballot, digest)
        if self._chosen.get(position) != digest and position in self.deciders:
            wrong.append(
                Wrong(
                    laws.CERTIFIED, f"a certificate of position {position} has {len(set(voters))} votes, of {len(self.deciders[position])}"
                )
            )
        if position not in self._certified:
            self._certified[position] = ballot
            first = self._first.get((position, digest), ballot)
            self.taken_over += first.node != ballot.node
        return wrong

    def decides(self, position: int, deciders: frozenset[Member]) -> list[Wrong]:
        """Who decides a position, by what was decided before it: at all nodes the same."""
        known = self.deciders.setdefault(position, deciders)
        return [] if known == deciders else [Wrong(laws.ONE_VALUE, f"position {position} is decided by others than it was elsewhere")]

    def _votes(self, member: Member, position: int, ballot: Ballot, digest: bytes) -> list[Wrong]:
        wrong = []
        known = self._values.setdefault((position, ballot), digest)
        self._first.setdefault((position, digest), ballot)
        if known != digest:
            wrong.append(Wrong(laws.PROMISES, f"ballot {ballot.counter} of {ballot.node} at position {position} has two values"))
        voters, deciders = self._voters[position, ballot], self.deciders.get(position)
        voters.add(member)
        if deciders is None:
            return wrong
        if member not in deciders:
            wrong.append(Wrong(laws.CERTIFIED, f"{_name(member)} votes at position {position}, and does not take part there"))
        if 2 * len(voters & deciders) > len(deciders) and self._chosen.setdefault(position, digest) != digest:
            wrong.append(Wrong(laws.ONE_VALUE, f"two values are chosen at position {position}"))
        return wrong


def _broken(member: Member, before: Paper, after: Paper) -> list[Wrong]:
    """Of one position: what was promised or voted for, and is not any more."""
    wrong = []
    if after.promised < before.promised:
        words = f"{_name(member)} promised {_words(before.promised)} at position {after.position}, and now {_words(after.promised)}"
        wrong.append(Wrong(laws.PROMISES, words))
    if before.accepted is not None and (after.accepted is None or after.accepted[0] < before.accepted[0]):
        wrong.append(Wrong(laws.PROMISES, f"{_name(member)} has forgotten its vote at position {after.position}"))
    return wrong


def _words(ballot: Ballot) -> str:
    return f"{ballot.counter} of {ballot.node}"


def _name(member: Member) -> str:
    return f"{member.node} ({member.incarnation.hex()[:6]})"
