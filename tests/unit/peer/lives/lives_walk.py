"""A node, a copy of its disk and voters that are exchanged, one step after the other, from a seed: no time, no network, any step that may happen.

So what takes an unlikely order of many steps, such as that a voter tells its lives and grants another one afterwards, comes up in seconds.
"""

from __future__ import annotations

import random
from dataclasses import dataclass, field

from scenefold.base.reasons import RejectReason
from scenefold.peer.cluster_log import lease_grants, telling_lives
from scenefold.peer.cluster_log.lease_asker import LeaseAsker
from scenefold.peer.cluster_log.lease_grants import Held, Question, Verdict
from scenefold.peer.cluster_log.numbered_lives import Life
from scenefold.peer.cluster_log.telling_lives import Gathering
from scenefold.peer.cluster_log.voter_rules import Council
from unit.peer.lives.lives_judge import Judge
from unit.peer.lives.lives_world import Entry, Sight, member, voters

STEPS = 120
POOL = 5
WHO = member(9)


@dataclass
class Voter:
    number: int
    position: int = 2
    held: Held = field(default_factory=Held)
    gathering: Gathering = field(default_factory=Gathering)


@dataclass
class Asker:
    """A disk, and a process on it."""

    disk: tuple[Life, ...] = ()
    process: LeaseAsker = field(default_factory=LeaseAsker)
    question: Question | None = None

    def __post_init__(self) -> None:
        self.start()

    def start(self) -> None:
        """Of lives as many may be drawn as are granted."""
        self.process, self.question = LeaseAsker.of_disk(self.disk, life_s=0.0), None


class Walk:
    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)
        first, second = Council(1, voters(frozenset({0}))), Council(2, voters(frozenset({0, 1, 2})))
        self.sights = {2: Sight(2, (first, second), frozenset({WHO}))}
        self.voters = [Voter(number, held=Held(ready_at=2 if number < 3 else 0)) for number in range(POOL)]
        self.askers = [Asker()]
        self.judge = Judge(0.0)
        self.nonce = 0
        self.may_copy = self.random.random() < 0.8
        """Else it is an honest node, and must never be refused."""
        self.asks_late = self.random.random() < 0.5
        """Else nobody asks as of voters that have changed, as far as anybody knows."""
        if self.random.random() < 0.5:
            self._copy()
        chances = {
            self._some_visit: 6,
            self._some_question: 2,
            self._some_telling: 5,
            self._some_learning: 4,
            self._exchange: 1,
            self._some_start: 0.3,
            self._copy: 0.5,
        }
        self.steps = list(chances)
        # Of some steps many more come in one walk than in another: what takes a long row of one kind comes up in some of them.
        self.weights = [weight * self.random.choice([0.1, 1.0, 3.0]) for weight in chances.values()]

    def run(self) -> None:
        for _ in range(STEPS):
            self._step()

    def _step(self) -> None:
        self.random.choices(self.steps, self.weights)[0]()

    def _some_visit(self) -> None:
        self._visit(self.random.choice(self.askers), self.random.choice(self.voters))

    def _some_question(self) -> None:
        self._ask(self.random.choice(self.askers))

    def _some_telling(self) -> None:
        voter = self.random.choice([one for one in self.voters if one.gathering.council_at] or self.voters)
        self._tell(self.random.choice(self.voters), voter)

    def _some_learning(self) -> None:
        self._learn(self.random.choice([one for one in self.voters if one.position + 1 in self.sights] or self.voters))

    def _some_start(self) -> None:
        self.random.choice(self.askers).start()

    def _copy(self) -> None:
        if not self.may_copy or len(self.askers) > 1:
            return
        self.judge.copied.add(WHO)
        self.askers.append(Asker(self.askers[0].disk))

    def _ask(self, asker: Asker) -> None:
        process, newest = asker.process, max(self.sights)
        asked = asker.question
        is_open = process.round is not None and asked is not None and (asked.have == newest or self.asks_late)
        if process.is_restored or (is_open and self.random.random() < 0.8):
            return
        if process.wants_life(0.0):
            process = process.drawn(self.random.getrandbits(32) or 1, 0.0)
            assert process.life is not None
            asker.disk = (process.life,)
        assert process.life is not None
        have = self.random.choice(list(self.sights)) if self.asks_late else newest
        self.nonce += 1
        who = self.sights[have].councils[-1].voters
        asker.question = Question(WHO, have, process.life, self.nonce)
        asker.process = process.asks(self.nonce, have, who, 0.0)
        self.judge.asked(asker.question, who)

    def _visit(self, asker: Asker, voter: Voter) -> None:
        """A question comes to a voter, and its answer back."""
        if asker.question is None:
            self._ask(asker)
        question = asker.question
        if question is None:
            return
        me, sight = member(voter.number), self.sights[voter.position]
        said = lease_grants.answer(question, voter.held, sight, me, is_awake=True, has_accepted=False)
        if said is Verdict.NOTE:
            voter.held = lease_grants.noted(voter.held, question)
            said = lease_grants.answer(question, voter.held, sight, me, is_awake=True, has_accepted=False)
        if said is Verdict.GRANT:
            self.judge.granted(question, me)
            asker.process = asker.process.granted(question.nonce, me)
        elif said is RejectReason.WRONG_INCARNATION:
            if asker.process.round is not None and me in asker.process.round.voters:
                self.judge.refused(question, is_removed=False)
            asker.process = asker.process.refused(question.nonce, me, said)

    def _tell(self, teller: Voter, voter: Voter) -> None:
        """All at once: asked, told and taken."""
        sight, at = self.sights[voter.position], voter.gathering.council_at
        if not at or not telling_lives.may_tell(at, teller.held, self.sights[teller.position], member(teller.number)):
            return
        lives = teller.held.lives
        voter.gathering, voter.held = telling_lives.told(voter.gathering, voter.held, member(teller.number), at, lives, sight, is_all=True)

    def _learn(self, voter: Voter) -> None:
        if voter.position + 1 in self.sights:
            voter.position += 1
            sight = self.sights[voter.position]
            voter.gathering, voter.held = telling_lives.gather(voter.gathering, voter.held, sight, member(voter.number))

    def _exchange(self) -> None:
        """Some of the voters for others, as far as a majority of those who vote for it is ready."""
        newest = self.sights[max(self.sights)]
        council = {int(one.member.node) for one in newest.councils[-1].voters.everyone}
        can = [one for one in self.voters if one.number in council and one.position == newest.position]
        able = [one for one in can if telling_lives.may_vote(changes_voters=True, held=one.held, log=newest, me=member(one.number))]
        if len(able) < newest.councils[-1].voters.majority or len(self.sights) > 4:
            return
        for _ in range(self.random.choice([1, 2, 2, 3])):
            council ^= {self.random.randrange(POOL)}
        if len(council) >= 2:
            self.sights[newest.position + 1] = newest.after(Entry(council=frozenset(council)))
