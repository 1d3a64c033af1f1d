"""Voters, nodes, and copies of their disks, from a seed: what peer/cluster_log decides about leases and lives, with a log that is chosen by
votes one position after the other, a network, and clocks of different rates.

How a value is chosen is not the subject: of each position there is one that voters may vote for, each when it comes to it.
"""

from __future__ import annotations

import heapq
import itertools
import random
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import lru_cache

from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.consensus import Participant, Participants
from scenefold.peer.cluster_log import lease_grants, telling_lives
from scenefold.peer.cluster_log.awakening import Awakening
from scenefold.peer.cluster_log.lease_asker import LeaseAsker
from scenefold.peer.cluster_log.lease_grants import KEPT_S, Held, Question, Verdict
from scenefold.peer.cluster_log.numbered_lives import Life
from scenefold.peer.cluster_log.telling_lives import Gathering
from scenefold.peer.cluster_log.voter_rules import Council
from scenefold.wire import Member
from unit.peer.lives.lives_judge import Broken, Judge

LEASE_S, LIFE_S, RENEW_S, ROUND_S = 3.0, 6.0, 1.0, 1.5
WAIT_S = 1.05 * LEASE_S
RATE = 0.01
TICK_S = 0.25


class _Key:
    """Nobody signs anything here."""

    def verify(self, signature: bytes, domain: bytes, message: bytes) -> None:
        raise NotImplementedError


KEY = _Key()


@lru_cache(None)
def member(node: int, life: int = 0) -> Member:
    return Member(NodeId(node), b"%08d%08d" % (node, life))


@lru_cache(None)
def voters(nodes: frozenset[int]) -> Participants:
    return Participants(tuple(Participant(member(node), KEY) for node in sorted(nodes)))


@dataclass(frozen=True)
class Entry:
    """What is decided at a position: who votes from then on, who is a member no more, or who is one now; or none of this."""

    council: frozenset[int] | None = None
    removes: Member | None = None
    adds: Member | None = None


@dataclass(frozen=True)
class Sight:
    """The log up to a position."""

    position: int
    councils: tuple[Council, ...]
    members: frozenset[Member]
    removed: frozenset[Member] = frozenset()

    def bars(self, who: Member) -> RejectReason | None:
        if who in self.removed:
            return RejectReason.WRONG_INCARNATION
        return None if who in self.members else RejectReason.NOT_AUTHORISED

    def after(self, entry: Entry) -> Sight:
        position = self.position + 1
        councils = self.councils if entry.council is None else (*self.councils, Council(position, voters(entry.council)))
        gone = frozenset() if entry.removes is None else {entry.removes}
        came = frozenset() if entry.adds is None else {entry.adds}
        return Sight(position, councils, (self.members - gone) | came, self.removed | gone)


@dataclass
class Disk:
    """What a machine keeps, whatever happens. `lives`: what it asks for leases under."""

    position: int = 1
    accepted: int | None = None
    """The position that it has voted at, until that is decided here."""
    held: Held = field(default_factory=Held)
    lives: tuple[Life, ...] = ()


@dataclass
class Kept:
    question: Question
    source: int
    until: float


class Process:
    """One life of a machine."""

    def __init__(self, disk: Disk) -> None:
        self.asker = LeaseAsker.of_disk(disk.lives, LEASE_S, LIFE_S)
        self.awakening = Awakening()
        self.gathering = Gathering()
        self.kept: list[Kept] = []
        self.asked_at = -1e9


class Machine:
    """A disk, a clock, and a process if one runs. Two of one member are a node and a copy of its disk."""

    def __init__(self, number: int, who: Member, disk: Disk, rate: float) -> None:
        self.number, self.who, self.disk, self.rate = number, who, disk, rate
        self.process: Process | None = None


@dataclass
class Weather:
    loss: float = 0.0
    again: float = 0.0
    """A question comes once more, later."""
    delay_s: tuple[float, float] = (0.01, 0.05)


class World:
    """`random` is the soup's as well: a seed is all there is."""

    def __init__(self, seed: int, voting: int, nodes: int, pool: int) -> None:
        self.random = random.Random(seed)
        self.now = 0.0
        self.weather = Weather()
        self.blocked: set[tuple[int, int]] = set()
        self.machines: dict[int, Machine] = {}
        self.sights: dict[int, Sight] = {}
        self.judge = Judge(WAIT_S / (1 + RATE))
        self.open: Entry | None = None
        self.votes: set[Member] = set()
        self.gossip = 1.0
        """How likely somebody hears at a tick how far somebody else's log has come."""
        self.forgets_lives = False
        self.leases_from_answers = False
        self._events: list[tuple[float, int, Callable[[], None]]] = []
        self._order = itertools.count()
        self._nonces = itertools.count(1)
        everybody = frozenset(member(node) for node in range(pool + nodes))
        self.sights[1] = Sight(1, (Council(1, voters(frozenset({0}))),), everybody)
        self.first_councils = [frozenset(range(voting))] if voting > 1 else []
        for node in range(pool + nodes):
            self.add(member(node), Disk())

    # ------------------------------------------------------------------------------------------------ machines

    def add(self, who: Member, disk: Disk) -> Machine:
        number = len(self.machines)
        rate = 1 + self.random.uniform(-RATE, RATE)
        one = self.machines[number] = Machine(number, who, disk, rate)
        self.start(one)
        return one

    def start(self, one: Machine) -> None:
        one.process = process = Process(one.disk)
        self._look(one, process)
        self._tick(one, process)

    def crash(self, one: Machine) -> None:
        one.process = None
        if self.forgets_lives:
            one.disk.held = replace(one.disk.held, lives={})

    def sight(self, one: Machine) -> Sight:
        return self.sights[one.disk.position]

    @property
    def newest(self) -> Sight:
        return self.sights[max(self.sights)]

    def of(self, who: Member) -> Iterable[Machine]:
        return (one for one in self.machines.values() if one.who == who)

    # ---------------------------------------------------------------------------------------------------- time

    def run(self, for_s: float) -> None:
        until = self.now + for_s
        while self._events and self._events[0][0] <= until:
            self.now, _, what = heapq.heappop(self._events)
            what()
        self.now = until

    def later(self, after_s: float, what: Callable[[], None]) -> None:
        heapq.heappush(self._events, (self.now + after_s, next(self._order), what))

    def local(self, one: Machine) -> float:
        return self.now * one.rate

    def _alive(self, one: Machine, process: Process, what: Callable[[], None]) -> Callable[[], None]:
        def go() -> None:
            if one.process is process:
                what()

        return go

    def _send(self, source: int, target: int, what: Callable[[Machine], None]) -> None:
        """To whatever process runs there when it comes."""

        def arrive() -> None:
            if (source, target) not in self.blocked and self.machines[target].process is not None:
                what(self.machines[target])

        if source == target:
            self.later(0.0, arrive)
        elif self.random.random() >= self.weather.loss:
            self.later(self.random.uniform(*self.weather.delay_s), arrive)

    # --------------------------------------------------------------------------------------------------- asking

    def _tick(self, one: Machine, process: Process) -> None:
        self.later(TICK_S * self.random.uniform(0.8, 1.2), self._alive(one, process, lambda: self._tick(one, process)))
        self._gossip(one)
        if one.process is not process:
            return
        self._expire(one, process)
        self._ask(one, process)
        self._ask_lives(one, process)
        self._vote(one, process)

    def _ask(self, one: Machine, process: Process) -> None:
        now, sight = self.local(one), self.sight(one)
        if sight.bars(one.who) is not None:
            process.asker = process.asker.removed()
            return
        if process.asker.wants_life(now):
            process.asker = process.asker.drawn(self.random.getrandbits(32) or 1, now)
            assert process.asker.life is not None
            one.disk.lives = (process.asker.life,)
        pause = ROUND_S if process.asker.round is not None else RENEW_S if process.asker.holds(now) else 0.0
        if now - process.asked_at < pause:
            return
        process.asked_at = now
        nonce, who = next(self._nonces), sight.councils[-1].voters
        process.asker = process.asker.asks(nonce, sight.position, who, now)
        assert process.asker.life is not None
        question = Question(one.who, sight.position, process.asker.life, nonce)
        self.judge.asked(question, who)
        for other in who.everyone:
            for target in self.of(other.member):
                self._send(one.number, target.number, self._questioned(question, one.number))
                if self.random.random() < self.weather.again:
                    self.later(self.random.uniform(1.0, 20.0), self._again(question, one.number, target.number))

    def _questioned(self, question: Question, source: int) -> Callable[[Machine], None]:
        return lambda voter: self._answer(voter, question, source)

    def _again(self, question: Question, source: int, target: int) -> Callable[[], None]:
        return lambda: self._send(source, target, self._questioned(question, source))

    # ------------------------------------------------------------------------------------------------- answering

    def _answer(self, voter: Machine, question: Question, source: int, kept_until: float | None = None) -> None:
        process = voter.process
        assert process is not None
        while True:
            said = lease_grants.answer(
                question,
                voter.disk.held,
                self.sight(voter),
                voter.who,
                is_awake=process.awakening.is_awake,
                has_accepted=voter.disk.accepted is not None,
            )
            if said is not Verdict.NOTE:
                break
            voter.disk.held = lease_grants.noted(voter.disk.held, question)
        if said is Verdict.WAIT:
            until = self.local(voter) + KEPT_S if kept_until is None else kept_until
            if self.local(voter) < until:
                process.kept.append(Kept(question, source, until))
                return
            said = Verdict.NOT_NOW
        if said is Verdict.GRANT:
            self.judge.granted(question, voter.who)
        answer, position = said, voter.disk.position
        self._send(voter.number, source, lambda asker: self._answered(asker, question, voter.who, answer, position))

    def _expire(self, one: Machine, process: Process) -> None:
        kept, process.kept = process.kept, []
        for each in kept:
            self._answer(one, each.question, each.source, each.until)

    def _answered(self, one: Machine, question: Question, voter: Member, said: Verdict | RejectReason, position: int) -> None:
        process = one.process
        assert process is not None
        before, nonce = process.asker, question.nonce
        is_mine = before.round is not None and before.round.nonce == nonce
        if isinstance(said, Verdict) or said is RejectReason.WRONG_INCARNATION:
            process.awakening = (
                process.awakening.answered(voter, is_refused=isinstance(said, RejectReason)) if is_mine else process.awakening
            )
        if said is Verdict.GRANT:
            process.asker = before.granted(nonce, voter)
        elif isinstance(said, RejectReason):
            if is_mine and said is RejectReason.WRONG_INCARNATION:
                self.judge.refused(question, is_removed=one.who in self.newest.removed)
            process.asker = before.refused(nonce, voter, said)
        if self.leases_from_answers and process.asker.until > before.until:
            process.asker = replace(process.asker, until=self.local(one) + LEASE_S)
        if process.asker.until > before.until:
            self.judge.leased(one.who, process.asker.until / one.rate)
        self._learn(one, position)
        if one.process is process:
            self._look(one, process)
            if process.asker.is_restored or process.awakening.is_over:
                # It begins anew, as somebody else.
                self.crash(one)

    # --------------------------------------------------------------------------------------------------- the log

    def _gossip(self, one: Machine) -> None:
        if self.random.random() >= self.gossip:
            return
        other = self.random.choice(list(self.machines.values()))
        if other.process is not None and (other.number, one.number) not in self.blocked:
            self._learn(one, other.disk.position)
        if one.disk.accepted == one.disk.position + 1 <= self.newest.position and self.random.random() < 0.2:
            # Somebody takes over what it has voted for, and finds that it was chosen.
            self._learn(one, one.disk.position + 1)

    def _learn(self, one: Machine, position: int) -> None:
        process = one.process
        assert process is not None
        while one.disk.position < position:
            one.disk.position, one.disk.accepted = one.disk.position + 1, None
            self.judge.learnt(self.sight(one), self.now)
            self._look(one, process)
        self._expire(one, process)

    def _look(self, one: Machine, process: Process) -> None:
        """At the log, as it is now."""
        sight = self.sight(one)
        process.gathering, one.disk.held = telling_lives.gather(process.gathering, one.disk.held, sight, one.who)
        process.awakening = process.awakening.looked_at(sight.councils[-1].voters, one.who)

    def propose(self, entry: Entry) -> None:
        """Voters may vote for it from now on. One at a time."""
        assert self.open is None
        self.open, self.votes = entry, set()

    def _vote(self, one: Machine, process: Process) -> None:
        sight, entry = self.sight(one), self.open
        if entry is None or sight.position != self.newest.position or one.disk.accepted is not None or self.random.random() < 0.7:
            return
        may = telling_lives.may_vote(changes_voters=entry.council is not None, held=one.disk.held, log=sight, me=one.who)
        if one.who not in sight.councils[-1].voters or not process.awakening.is_awake or not may:
            return
        one.disk.accepted = sight.position + 1
        self.votes.add(one.who)
        if len(self.votes) >= sight.councils[-1].voters.majority:
            self.sights[sight.position + 1] = sight.after(entry)
            self.open = None
            if self.random.random() < 0.5:
                self._learn(one, sight.position + 1)

    # ----------------------------------------------------------------------------------------------------- lives

    def _ask_lives(self, one: Machine, process: Process) -> None:
        at = process.gathering.council_at
        for who in telling_lives.to_ask(process.gathering, self.sight(one)):
            for target in self.of(who):
                self._send(one.number, target.number, lambda teller: self._tell(teller, one.number, at))

    def _tell(self, teller: Machine, asker: int, at: int) -> None:
        if not telling_lives.may_tell(at, teller.disk.held, self.sight(teller), teller.who):
            return
        lives, who = dict(teller.disk.held.lives), teller.who

        def told(one: Machine) -> None:
            assert one.process is not None
            one.process.gathering, one.disk.held = telling_lives.told(
                one.process.gathering, one.disk.held, who, at, lives, self.sight(one), is_all=True
            )

        self._send(teller.number, asker, told)


__all__ = ["Broken", "Disk", "Entry", "Machine", "Weather", "World", "member"]
