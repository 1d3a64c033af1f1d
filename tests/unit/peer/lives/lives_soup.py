"""Anything at any time, from a seed: voters come and go, nodes are removed, disks are copied, put back and run twice, some cannot hear others;
then quiet, in which every node whose disk was never copied must get its lease."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace

from unit.peer.lives.lives_world import Broken, Disk, Entry, Machine, Weather, World, member

OPERATIONS = 80
QUIET_S = 60.0


class Soup:
    def __init__(self, seed: int) -> None:
        self.pool = 4 + seed % 3
        self.world = World(seed, 1, 2, self.pool)
        self.random = self.world.random
        self.counts: Counter[str] = Counter()
        self.crashes = 4
        self.backups: list[tuple[Machine, Disk]] = []
        self.lives_of: Counter[int] = Counter()

    def run(self) -> None:
        """All of it; Broken where something does not hold."""
        first = self.random.sample(range(self.pool), self.random.choice([2, 3, 3, 4]))
        self.world.run(3.0)
        self.world.propose(Entry(council=frozenset({0, *first})))
        self.world.run(10.0)
        self._bad_weather()
        self.world.gossip = self.random.choice([1.0, 0.3, 0.1, 0.03])
        for _ in range(OPERATIONS):
            self.world.run(self.random.choice([0.1, 0.3, 1.0, 3.0]))
            self._operate()
        self._settle()

    def _bad_weather(self) -> None:
        loss, slow = self.random.choice([0.0, 0.1, 0.4, 0.6]), self.random.choice([0.02, 0.3, 1.0])
        self.world.weather = Weather(loss, self.random.choice([0.0, 0.2]), (0.01, slow))

    # --------------------------------------------------------------------------------------------------- operations

    def _operate(self) -> None:
        chances: dict[Callable[[], bool], int] = {
            self._decide: 6,
            self._change_voters: 10,
            self._remove: 4,
            self._copy: 4,
            self._twins: 6,
            self._put_back: 3,
            self._keep_backup: 2,
            self._crash: self.crashes,
            self._restart: 8,
            self._part: 5,
            self._deafen: 6,
            self._heal: 5,
        }
        what = self.random.choices(list(chances), list(chances.values()))[0]
        self.counts[what.__name__.strip("_")] += what()

    @property
    def council(self) -> frozenset[int]:
        return frozenset(int(one.member.node) for one in self.world.newest.councils[-1].voters.everyone)

    def _decide(self) -> bool:
        return self._propose(Entry())

    def _propose(self, entry: Entry) -> bool:
        if self.world.open is not None:
            return False
        self.world.propose(entry)
        return True

    def _change_voters(self) -> bool:
        """However many at once: it does not matter how much of the set changes."""
        council = set(self.council)
        for _ in range(self.random.choice([1, 1, 2, 3])):
            council ^= {self.random.randrange(self.pool)}
        return bool(council) and council != self.council and self._propose(Entry(council=frozenset(council)))

    def _nodes(self) -> list[int]:
        """Who never votes."""
        return [self.pool, self.pool + 1]

    def _remove(self) -> bool:
        """An incarnation goes, and another one comes."""
        node = self.random.choice(self._nodes())
        before = member(node, self.lives_of[node])
        if before not in self.world.newest.members or self.world.open is not None:
            return False
        self.lives_of[node] += 1
        after = member(node, self.lives_of[node])
        self.world.propose(Entry(removes=before, adds=after))
        self.world.add(after, Disk(position=self.random.randint(1, self.world.newest.position)))
        return True

    def _some_node(self, is_up: bool) -> Machine | None:
        machines = list(self.world.machines.values())[-6:]
        found = [one for one in machines if int(one.who.node) >= self.pool and (one.process is not None) is is_up]
        return self.random.choice(found) if found else None

    def _copy(self) -> bool:
        """It runs elsewhere, beside the one that it is a copy of."""
        one = self._some_node(is_up=True)
        return one is not None and self._copy_of(one)

    def _copy_of(self, one: Machine) -> bool:
        if len(self.world.machines) > self.pool + 16:
            return False
        self.world.judge.copied.add(one.who)
        self.world.add(one.who, replace(one.disk))
        return True

    def _twins(self) -> bool:
        """A node and its copy, each of which hears some of the voters; and perhaps others are about to vote."""
        one = self._some_node(is_up=True)
        if one is None or not self._copy_of(one):
            return False
        council = [each.number for each in self.world.machines.values() if each.number in self.council]
        for number in (one.number, len(self.world.machines) - 1):
            for voter in council:
                if self.random.random() < 0.5:
                    self.world.blocked |= {(voter, number), (number, voter)}
        if self.random.random() < 0.5:
            self.world.run(self.random.uniform(0.0, 6.0))
            self._change_voters()
        return True

    def _keep_backup(self) -> bool:
        one = self._some_node(is_up=True)
        if one is not None:
            self.backups.append((one, replace(one.disk)))
        return one is not None

    def _put_back(self) -> bool:
        """An older state of a disk."""
        if not self.backups:
            return False
        one, disk = self.random.choice(self.backups)
        self.world.crash(one)
        self.world.judge.copied.add(one.who)
        one.disk = replace(disk)
        self.world.start(one)
        return True

    def _crash(self) -> bool:
        ups = [one for one in self.world.machines.values() if one.process is not None]
        if ups:
            self.world.crash(self.random.choice(ups))
        return bool(ups)

    def _restart(self) -> bool:
        downs = [one for one in self.world.machines.values() if one.process is None]
        if downs:
            self.world.start(self.random.choice(downs))
        return bool(downs)

    def _part(self) -> bool:
        numbers = list(self.world.machines)
        self.random.shuffle(numbers)
        cut = self.random.randrange(1, len(numbers))
        self.world.blocked |= {pair for a in numbers[:cut] for b in numbers[cut:] for pair in ((a, b), (b, a))}
        return True

    def _deafen(self) -> bool:
        """A voter and somebody do not hear each other."""
        voter, other = self.random.randrange(self.pool), self.random.choice(list(self.world.machines))
        self.world.blocked |= {(voter, other), (other, voter)}
        return True

    def _heal(self) -> bool:
        self.world.blocked.clear()
        self._bad_weather()
        return True

    # ------------------------------------------------------------------------------------------------------- the end

    def _settle(self) -> None:
        world, judge = self.world, self.world.judge
        world.blocked.clear()
        world.gossip = 1.0
        world.weather = Weather()
        for one in world.machines.values():
            if one.process is None:
                world.start(one)
        world.run(QUIET_S)
        if world.open is not None:
            raise Broken(f"nobody decides {world.open}")
        for one in world.machines.values():
            if one.who in judge.copied or one.who not in world.newest.members:
                continue
            if one.process is None or not one.process.asker.holds(world.local(one)):
                raise Broken(f"{one.who}: it was never copied, and gets no lease")
        self.counts += judge.counts


def found_after(seeds: int, change: Callable[[Soup], None] = lambda soup: None) -> tuple[int, str] | None:
    """After how many seeds a claim is broken, and which; None if none is."""
    for seed in range(seeds):
        soup = Soup(seed)
        change(soup)
        try:
            soup.run()
        except AssertionError as broken:
            return seed + 1, str(broken)
    return None
