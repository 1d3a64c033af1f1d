"""Anything at any time, from a seed: what is asked for, crashes, wiped disks, partitions, full disks, members that change; then quiet.

While it goes on the laws are watched; afterwards everybody must come to the same log, and a fresh request must get through.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from random import Random

from scenefold.consensus import Outcome, Reply
from scenefold.wire import Member
from unit.consensus.logs_made import NOTHING, Change, member
from unit.consensus.world import DEADLINE_S, Weather, World

OPERATIONS = 40
QUIET_S = 120.0


class Soup:
    def __init__(self, seed: int) -> None:
        nodes = range(1, 4 + seed % 3)
        self.world = World(seed, *nodes, weather=Weather(delay_s=(0.01, 0.02)))
        self.random = self.world.random
        self.asked = 0
        self.counts: Counter[str] = Counter()
        self.same_incarnation = False
        """A mutant: who is wiped comes back under the incarnation that it had."""
        base = self.random.choice([0.0, 0.0, 0.05, 0.1])
        slow = self.random.choice([0.02, 0.05, 0.3, 1.0])
        self.world.weather = Weather(base, base, self.random.choice([0.0, 0.1]), (0.01, slow))
        self.haste = Random(f"haste {seed}")
        """Dice of their own: who may go without promises, and what goes straight to everybody."""
        self.hasty = self.haste.choice([0.0, 0.5, 1.0])
        self.world.at_once_bytes = self.haste.choice([0, 1_000_000])
        self.world.keep_in_step()

    def run(self) -> None:
        """All of it; Broken, or an AssertionError, where something does not hold."""
        for _ in range(OPERATIONS):
            self.world.run(self.random.choice([0.0, 0.02, 0.1, 0.5, 2.0]))
            self._operate()
        self._settle()

    # --------------------------------------------------------------------------------------------------- operations

    def _operate(self) -> None:
        chances: dict[Callable[[], bool], int] = {
            self._ask: 12,
            self._change_members: 4,
            self._ask_again: 2,
            self._crash: 4,
            self._crash_soon: 6,
            self._restart: 8,
            self._part: 2,
            self._deafen: 2,
            self._heal: 3,
            self._fill: 1,
            self._empty: 2,
            self._wipe: 1,
            self._replay: 3,
        }
        what = self.random.choices(list(chances), list(chances.values()))[0]
        self.counts[what.__name__.strip("_")] += what()

    def _ups(self) -> list[int]:
        return [node for node in self.world.nodes if self.world.up(node)]

    def _ask(self, change: Change = NOTHING) -> bool:
        ups = self._ups()
        if not ups:
            return False
        self.asked += 1
        self._ask_one(self.random.choice(ups), f"r{self.asked}", change, within=self.random.choice([2.0, 10.0, 30.0]))
        return True

    def _ask_one(self, asker: int, request: str, change: Change, *, within: float) -> None:
        """Who is the first there is asked as often as all others together, if it goes without promises."""
        is_plain = self.haste.random() < self.hasty
        first = self.world.nodes[asker].book.participants.first
        if is_plain and self.world.up(first) and self.haste.random() < 0.5:
            asker = first
        self.world.ask(asker, request, change, within=within, needs_consent=not is_plain)

    def _change_members(self) -> bool:
        """One joins or leaves, so that of those who are left a majority still has its disk."""
        ups = self._ups()
        if not ups:
            return False
        asker = self.random.choice(ups)
        everyone = {one.member for one in self.world.nodes[asker].book.participants.everyone}
        newest = {node.disk.member for node in self.world.nodes.values()}
        taken = {who.node for who in everyone}
        joining = [who for who in newest if who.node not in taken]
        leaving = [who for who in everyone if self._lives(everyone - {who})]
        changes = [Change(joins=who) for who in sorted(joining, key=_order)] + [Change(leaves=who) for who in sorted(leaving, key=_order)]
        gone = [change for change in changes if change.leaves is not None and change.leaves not in newest]
        if not changes:
            return False
        self.asked += 1
        self._ask_one(asker, f"m{self.asked}", self.random.choice(gone or changes), within=DEADLINE_S)
        return True

    def _lives(self, everyone: set[Member]) -> bool:
        return len(everyone - self.world.laws.gone) >= len(everyone) // 2 + 1 and len(everyone) > 1

    def _ask_again(self) -> bool:
        """A barrier, at anybody."""
        ups = self._ups()
        if not ups:
            return False
        self.world.ask_again(self.random.choice(ups), None, within=5.0)
        return True

    def _crash(self) -> bool:
        ups = self._ups()
        if ups:
            self.world.crash(self.random.choice(ups))
        return bool(ups)

    def _crash_soon(self) -> bool:
        """At one of the next effects."""
        ups = self._ups()
        if ups:
            self.world.crash_in[self.random.choice(ups)] = self.random.randrange(8)
        return bool(ups)

    def _restart(self) -> bool:
        downs = [node for node in self.world.nodes if not self.world.up(node)]
        if downs:
            self.world.start(self.random.choice(downs))
        return bool(downs)

    def _wipe(self) -> bool:
        """Only while a majority of whoever may decide, now or after any value that is about, keeps its disk."""
        downs = [node for node in self.world.nodes if not self.world.up(node)]
        laws = self.world.laws
        if not downs:
            return False
        node = self.random.choice(downs)
        who = self.world.nodes[node].disk.member
        lost = laws.gone | {who}
        groups = [{one.member for one in known.everyone} for known in laws.deciders.values()]
        newest = {one.member for one in laws.deciders[max(laws.deciders)].everyone}
        groups += [newest - {one} for one in newest] if len(newest) > 1 else []
        open_position = max(laws.deciders)
        if any(len(group & lost) > len(group) - (len(group) // 2 + 1) for group in groups[open_position - 1 :]):
            return False
        if self._holders_left(open_position, lost):
            return False
        before = self.world.nodes[node].disk.member
        self.world.wipe(node, same_incarnation=self.same_incarnation)
        if self.same_incarnation:
            laws.gone.discard(before)
        self.world.start(node)
        return True

    def _holders_left(self, position: int, lost: set[Member]) -> bool:
        """What was decided must not be lost with the only disks that know it."""
        return any(not laws_holders - lost for at, laws_holders in self._deciders().items() if at < position)

    def _deciders(self) -> dict[int, set[Member]]:
        found: dict[int, set[Member]] = {}
        for known in self.world.nodes.values():
            for position in range(1, len(known.disk.log) + 1):
                found.setdefault(position, set()).add(known.disk.member)
        return found

    def _part(self) -> bool:
        nodes = list(self.world.nodes)
        self.random.shuffle(nodes)
        cut = self.random.randrange(1, len(nodes))
        self.world.part(nodes[:cut], nodes[cut:])
        return True

    def _deafen(self) -> bool:
        """One hears others no more, or they do not hear it."""
        node = self.random.choice(list(self.world.nodes))
        others = self.random.sample(list(self.world.nodes), 2)
        for other in others:
            self.world.blocked.add((node, other) if self.random.random() < 0.5 else (other, node))
        return True

    def _heal(self) -> bool:
        self.world.heal()
        return True

    def _fill(self) -> bool:
        self.world.nodes[self.random.choice(list(self.world.nodes))].disk.is_full = True
        return True

    def _empty(self) -> bool:
        for node in self.world.nodes.values():
            node.disk.is_full = False
        return True

    def _replay(self) -> bool:
        for _ in range(min(10, len(self.world.packets))):
            _, source, target, message = self.random.choice(self.world.packets)
            self.world.deliver(source, target, message)
        return True

    # ------------------------------------------------------------------------------------------------------- the end

    def _settle(self) -> None:
        world = self.world
        world.heal()
        world.crash_in.clear()
        self._empty()
        world.weather = Weather(delay_s=(0.01, 0.02))
        for node in world.nodes:
            if not world.up(node):
                world.start(node)
        world.run(QUIET_S)
        log = world.agree()
        reply = self._last_request()
        assert reply.outcome is Outcome.COMMITTED, reply
        # Who takes no part any more hears of it only by asking, and asks anybody.
        world.run(QUIET_S)
        assert world.agree() == [*log, "last"], world.agree()

    def _last_request(self) -> Reply:
        world = self.world
        newest = world.laws.deciders[max(world.laws.deciders)]
        taking = [node for node, known in world.nodes.items() if known.disk.member in newest]
        asker = self.random.choice(taking)
        before = len(world.nodes[asker].replies)
        world.ask(asker, "last")
        world.run(40.0, lambda: len(world.nodes[asker].replies) > before)
        return world.nodes[asker].replies[-1]


def _order(who: Member) -> tuple[int, bytes]:
    return who.node, who.incarnation


def found_after(seeds: int, change: Callable[[Soup], None] = lambda soup: None) -> int | None:
    """After how many seeds a law is broken; None if none is."""
    for seed in range(seeds):
        soup = Soup(seed)
        change(soup)
        try:
            soup.run()
        except AssertionError:
            return seed + 1
    return None


__all__ = ["Soup", "found_after", "member"]
