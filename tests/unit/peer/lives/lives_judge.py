"""What specs/26-modes.md claims of leases and lives, watched from outside, where everything is known."""

from __future__ import annotations

from collections import Counter, defaultdict
from typing import TYPE_CHECKING

from scenefold.consensus import Participants
from scenefold.peer.cluster_log.lease_grants import Question
from scenefold.peer.cluster_log.numbered_lives import Life
from scenefold.wire import Member

if TYPE_CHECKING:
    from unit.peer.lives.lives_world import Sight

SLACK_S = 1e-6


class Broken(AssertionError):
    """A claim does not hold."""


class Judge:
    """`wait_s`: T_WAIT in true time, on the fastest clock."""

    def __init__(self, wait_s: float) -> None:
        self.wait_s = wait_s
        self.copied: set[Member] = set()
        """Of whose disk there was a copy at some time."""
        self.newest: dict[Member, Life] = {}
        """The highest life that a majority has granted."""
        self.counts: Counter[str] = Counter()
        self._asked: dict[int, tuple[Participants, bool]] = {}
        self._grants: dict[int, set[Member]] = defaultdict(set)
        self._lease_ends: dict[Member, float] = {}
        self._removal_learnt: dict[Member, float] = {}

    def asked(self, question: Question, voters: Participants) -> None:
        newest, life = self.newest.get(question.member), question.life
        is_late = newest is not None and (newest.number > life.number or (newest.number == life.number and newest != life))
        self._asked[question.nonce] = voters, is_late
        self.counts["asked late"] += is_late

    def granted(self, question: Question, voter: Member) -> None:
        """By one voter."""
        voters, is_late = self._asked[question.nonce]
        grants = self._grants[question.nonce]
        if voter not in voters or voter in grants:
            return
        grants.add(voter)
        if len(grants) != voters.majority:
            return
        self.counts["granted"] += 1
        life, newest = question.life, self.newest.get(question.member)
        self._hold(not is_late, f"{question.member}: a copy that lags is granted {life} again, behind {newest}")
        if newest is not None and newest.number == life.number:
            self._hold(newest == life, f"{question.member}: two lives of one number are granted, {newest} and {life}")
        if newest is None or newest.number < life.number:
            self.newest[question.member] = life

    def refused(self, question: Question, *, is_removed: bool) -> None:
        """With 18, at who waits for the answer."""
        self.counts["refused"] += 1
        is_honest = question.member not in self.copied and not is_removed
        self._hold(not is_honest, f"{question.member}: an honest node is refused under {question.life}")

    def leased(self, who: Member, until: float) -> None:
        """Until then, in true time."""
        self.counts["leased"] += 1
        self._lease_ends[who] = max(until, self._lease_ends.get(who, 0.0))
        self._look(who)

    def learnt(self, sight: Sight, now: float) -> None:
        """Somebody knows the log up to a position."""
        for who in sight.removed - self._removal_learnt.keys():
            self._removal_learnt[who] = now
            self.counts["removed"] += 1
            self._look(who)

    def _look(self, who: Member) -> None:
        learnt, until = self._removal_learnt.get(who), self._lease_ends.get(who, 0.0)
        if learnt is not None:
            end = learnt + self.wait_s
            self._hold(until <= end + SLACK_S, f"{who}: a lease is held {until - end:.2f} s longer than is waited for behind its removal")

    def _hold(self, fact: bool, what: str) -> None:
        if not fact:
            raise Broken(what)
