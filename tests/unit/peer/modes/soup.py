"""Leases of a scene, anything at any time, from a seed: ballots, votes, crashes, clocks that run wrong, clients, switches, removals.

`Soup(seed).run()` fails for a seed always or never, and says which.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from typing import TypeVar

from scenefold.wire import Ballot, Member
from unit.peer.modes.village import NO_BALLOT, Broken, Value, Village

OPERATIONS = 600
Thing = TypeVar("Thing")


class Soup:
    def __init__(self, seed: int) -> None:
        self.seed = seed
        self.village = Village(seed, nodes=1 + seed % 5, observers=seed // 5 % 3)
        self.random = self.village.random
        self.counts: Counter[str] = Counter()
        self.village.let_pass(20.0)
        self.slow = {member for member in self.village.nodes if self.random.random() < 0.3}
        self.chances = self._chances()
        self.jumps = self.random.choice([0.0, 0.01, 0.04])
        self.pace = self.random.choice([0.01, 0.03, 0.1, 0.3])

    def run(self) -> None:
        """All of it; Broken, with the seed to begin it anew with, where I7 does not hold."""
        try:
            for _ in range(OPERATIONS):
                self._wait()
                self._operate()
                self.village.judge()
                self._count()
        except Broken as broken:
            raise Broken(f"seed {self.seed}: {broken}") from broken

    def _count(self) -> None:
        self.counts["active"] += self.village.acting() > 0
        self.counts["leased"] += any(True for _ in self.village.leases())

    def _wait(self) -> None:
        """Mostly a moment; now and then until leases end, or almost."""
        if self.random.random() < self.jumps:
            self.village.let_pass(self.random.uniform(10.0, 14.0))
        else:
            self.village.let_pass(self.random.choice([0.0, 0.0, 0.01, self.pace, 3 * self.pace]))

    def _chances(self) -> dict[Callable[[], bool], float]:
        """How often what is done; each soup does some things often, and others hardly ever."""
        chances: dict[Callable[[], bool], int] = {
            self._mail: 50,
            self._ask: 20,
            self._open: 6,
            self._vote: 12,
            self._learn: 8,
            self._show_votes: 12,
            self._release: 10,
            self._hear: 10,
            self._borrow: 8,
            self._give_back: 2,
            self._begin_anew: 1,
            self._crash: 1,
            self._start: 4,
            self._get: 6,
            self._decide: 3,
            self._tell: 4,
        }
        return {what: chance * self.random.choice([0.3, 1.0, 1.0, 3.0]) for what, chance in chances.items()}

    def _operate(self) -> None:
        what = self.random.choices(list(self.chances), list(self.chances.values()))[0]
        self.counts[what.__name__.strip("_")] += what()

    def _someone(self) -> Member:
        return self.random.choice(list(self.village.nodes))

    def _awake(self) -> list[Member]:
        """Those that may take part in the log now: some are slow."""
        return [member for member in self.village.nodes if member not in self.slow or self.random.random() < 0.05]

    def _one_of(self, some: Iterable[Thing]) -> Thing | None:
        found = list(some)
        return self.random.choice(found) if found else None

    def _mail(self) -> bool:
        """What is on its way comes, mostly once, out of turn, or never."""
        mail = self.village.mail
        if not mail:
            return False
        for _ in range(self.random.randrange(1, 5)):
            self._deliver(mail)
        return True

    def _deliver(self, mail: list[Callable[[], None]]) -> None:
        if not mail:
            return
        at = self.random.randrange(max(0, len(mail) - 12), len(mail))
        what = mail[at] if self.random.random() < 0.05 else mail.pop(at)
        if self.random.random() > 0.05:
            what()

    def _ask(self) -> bool:
        return self.village.ask(self._someone())

    def _open(self) -> bool:
        village = self.village
        newest = max(village.positions)
        at = village.positions[newest]
        if newest > 12 or len(at.values) > 10:
            return False
        ready = [member for member in at.scene.participants if village.up(member) and village.nodes[member].scene is at.scene]
        ready.sort(key=_order)
        majority = len(at.scene.participants) // 2 + 1
        if len(ready) < majority:
            return False
        promising = self.random.sample(ready, majority)
        highest = max([*at.values, NO_BALLOT]).counter
        ballot = Ballot(self.random.choice([highest + 1, max(1, highest)]), promising[0].node)
        return village.open_ballot(newest, promising, ballot, self._wish(newest))

    def _wish(self, position: int) -> Value:
        scene = self.village.positions[position].scene
        kind = self.random.random()
        if kind < 0.55:
            return Value(self.village.number(), switches=True)
        leaving = sorted(scene.everyone & self.slow or scene.everyone, key=_order)
        if kind < 0.8 and len(scene.participants) > 1:
            return Value(self.village.number(), leaves=self.random.choice(leaving))
        return Value(self.village.number())

    def _vote(self) -> bool:
        """Somebody for a ballot that is open to him, mostly the newest."""
        village = self.village
        open_ones = [(member, village.ballots(member)) for member in self._awake()]
        able = self._one_of((member, ballots) for member, ballots in open_ones if ballots)
        if able is None:
            return False
        member, ballots = able
        return village.vote(member, self.random.choice([*ballots, ballots[-1], ballots[-1]]))

    def _learn(self) -> bool:
        village = self.village
        nodes = ((member, village.nodes[member]) for member in self._awake())
        open_ones = ((member, village.positions.get(node.scene.position + 1)) for member, node in nodes)
        member = self._one_of(member for member, at in open_ones if at is not None and at.chosen is not None)
        return member is not None and village.learn(member)

    def _show_votes(self) -> bool:
        return self.village.show_votes(self._someone())

    def _release(self) -> bool:
        return self.village.release(self._someone())

    def _hear(self) -> bool:
        return self.village.hear(self._someone())

    def _get(self) -> bool:
        """A lease, at once; often somebody slow."""
        member = self._one_of(sorted(self.slow, key=_order)) if self.random.random() < 0.5 else None
        member, mail = member or self._someone(), self.village.mail
        before = len(mail)
        if not self.village.ask(member):
            return False
        while len(mail) > before:
            mail.pop()()
        return True

    def _decide(self) -> bool:
        """Something, by all who are awake, and they learn it."""
        village, awake = self.village, self._awake()
        if not self._open():
            return False
        ballot = max(village.positions[max(village.positions)].values)
        for member in awake:
            if ballot in village.ballots(member):
                village.vote(member, ballot)
        for member in awake:
            village.learn(member)
        return True

    def _tell(self) -> bool:
        """All who are awake say what they may, and hear all."""
        for _ in range(2):
            for member in self._awake():
                self.village.show_votes(member, all_of_them=True)
                self.village.release(member)
                self.village.hear(member, all_of_them=True)
        return True

    def _borrow(self) -> bool:
        return self.village.borrow(self.random.randrange(len(self.village.clients)), self._someone())

    def _give_back(self) -> bool:
        return self.village.give_back(self.random.randrange(len(self.village.clients)))

    def _begin_anew(self) -> bool:
        return self.village.begin_anew(self.random.randrange(len(self.village.clients)))

    def _crash(self) -> bool:
        member = self._someone()
        was_up = self.village.up(member)
        self.village.crash(member)
        if was_up and self.random.random() < 0.7:
            self.village.start(member)
        return was_up

    def _start(self) -> bool:
        member = self._one_of(member for member in self.village.nodes if not self.village.up(member))
        if member is not None:
            self.village.start(member)
        return member is not None


def _order(member: Member) -> int:
    return member.node


def found_after(seeds: int) -> int | None:
    """After how many seeds I7 is broken; None if it never is."""
    for seed in range(seeds):
        try:
            Soup(seed).run()
        except Broken:
            return seed + 1
    return None
