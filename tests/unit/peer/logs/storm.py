"""Clients that ask, and everything that can go wrong meanwhile, from a seed; then calm, in which all must come to one log.

`Storm(seed).run()` raises what was broken. By hand: `PYTHONPATH=src:tests python -m unit.peer.logs.storm FIRST COUNT`.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable
from typing import Any

import trio

from scenefold.base.errors import Refused
from scenefold.base.reasons import RejectReason
from scenefold.consensus import Outcome
from scenefold.peer.logs import Answer
from scenefold.world import leaves
from scenefold.world.sim import Delay, Point, Weather, dice, run_simulated
from unit.consensus.laws import Broken
from unit.peer.logs.town import Node, Town, request_maker, until
from unit.peer.logs.watch import log_on, slot_on

SIZES = 3, 5, 7
CLIENTS = 3
STORM_S = 40.0
CALM_S = 60.0
TRIES = 4


class Storm:
    def __init__(self, seed: int, *, storm_s: float = STORM_S) -> None:
        self.seed, self.storm_s = seed, storm_s
        self.dice = dice(seed, "storm")
        self.counts: Counter[str] = Counter()
        self.minds_disks = True
        loss = self.dice.choice([0.0, 0.02, 0.1])
        slow = self.dice.choice([0.005, 0.02, 0.2])
        delay = Delay(0.0005, self.dice.choice([0.0005, 0.005]), slow)
        self.weather = Weather(delay, loss=loss, duplication=loss, reordering=loss)
        self.count = SIZES[seed % len(SIZES)]
        self.haste = dice(seed, "haste")
        """Of their own: who may go without promises, and what goes straight to everybody."""
        self.hasty = self.haste.choice([0.0, 0.5, 1.0])
        self.at_once_bytes = self.haste.choice([0, 1_000_000])

    def run(self) -> None:
        """Broken, or an AssertionError, where something does not hold."""
        try:
            run_simulated(self.seed, self._run, virtual_s_max=2_000.0, wall_s_max=120.0)
        except BaseExceptionGroup as group:
            raise next(leaves(group)) from group

    async def _run(self) -> None:
        self.town = Town(self.seed, self.weather, sees_cracks=self.dice.random() < 0.5)
        self.town.replayed = self.dice.choice([0.0, 0.02])
        self.town.at_once_bytes = self.at_once_bytes
        async with trio.open_nursery() as nursery:
            await self.town.found(self.count, nursery)
            self.town.watch.minds_disks = self.minds_disks
            for node in self.town.nodes.values():
                self.town.start(node)
            with trio.move_on_after(self.storm_s):
                async with trio.open_nursery() as stormy:
                    for number in range(CLIENTS):
                        stormy.start_soon(self._client, number)
                    stormy.start_soon(self._weather)
            if self.town.watch.broken is None:
                await self._settle()
            nursery.cancel_scope.cancel()
        self.town.watch.judge_history()
        assert not self.town.ends, self.town.ends
        self.counts["decided"] += len(self.town.watch.books) - 1

    # ------------------------------------------------------------------------------------------------------ clients

    async def _client(self, number: int) -> None:
        for count in range(10_000):
            await trio.sleep(self.dice.random() ** 2)
            await self._one(f"c{number}.{count}")

    async def _one(self, request: str) -> None:
        """Ask until it is known what became of it, or for so long that nobody would wait any longer."""
        town, is_begun, asked = self.town, False, None
        for _ in range(TRIES):
            ups = town.up()
            if not ups:
                await trio.sleep(0.5)
                continue
            node = self.dice.choice(ups)
            asked = asked or town.watch.begins(request, town.net.now)
            answer = await self._ask(node, request)
            if answer is not None and answer.outcome is Outcome.COMMITTED:
                town.watch.told(asked, answer, town.net.now)
                return
            if answer is not None and answer.outcome is Outcome.REJECTED and not is_begun:
                # Not begun anywhere, and asked for no more: it never will be.
                town.watch.told(asked, answer, town.net.now)
                return
            is_begun = True
            if self.dice.random() < 0.3:
                await self._ask(self.dice.choice(town.up() or [node]), None)

    async def _ask(self, node: Node, request: str | None) -> Answer | None:
        """None if it is not known."""
        is_plain = request is not None and self.haste.random() < self.hasty
        first = self.town.by_id[self.town.first.participants.first]
        if is_plain and first.log is not None and self.haste.random() < 0.5:
            # Who goes without promises is asked as often as all others together.
            node = first
            self.counts["asked the first"] += 1
        log = node.log
        if log is None:
            return None
        make: Any = None if request is None else request_maker(request, node)
        try:
            within_s, is_for_all = self.dice.choice([2.0, 5.0, 15.0]), self.dice.random() < 0.1
            answer = await log.ask(make, within_s, is_for_all=is_for_all, needs_consent=not is_plain)
        except Refused as refused:
            self.counts[f"refused {refused.reason.name}"] += 1
            # Of a node that has ended nobody knows whether it had begun; it says so only of what it had not.
            return Answer(Outcome.REJECTED, 0, refused.reason) if refused.reason is not RejectReason.ILL_FORMED else None
        self.counts[answer.outcome.name] += 1
        return answer

    # ------------------------------------------------------------------------------------------------------- faults

    async def _weather(self) -> None:
        while True:
            await trio.sleep(self.dice.choice([0.05, 0.2, 0.5, 1.5]))
            chances: dict[Callable[[], bool], int] = {
                self._crash: 3,
                self._crash_at: 6,
                self._restart: 8,
                self._part: 3,
                self._deafen: 3,
                self._heal: 5,
                self._fill: 1,
                self._empty: 3,
                self._pause: 1,
                self._slow: 1,
            }
            what = self.dice.choices(list(chances), list(chances.values()))[0]
            self.counts[what.__name__.strip("_")] += what()

    def _crash(self) -> bool:
        ups = self.town.up()
        if ups:
            self.town.crash(self.dice.choice(ups), silent=self.dice.random() < 0.5)
        return bool(ups)

    def _crash_at(self) -> bool:
        """Just before or after one of its next sends or commits."""
        ups = self.town.up()
        if ups:
            self.town.crash_at(self.dice.choice(ups), self.dice.choice(list(Point)), self.dice.randrange(1, 12))
        return bool(ups)

    def _restart(self) -> bool:
        downs = self.town.down()
        if downs:
            self.town.start(self.dice.choice(downs))
        return bool(downs)

    def _part(self) -> bool:
        nodes = [node.address for node in self.town.nodes.values()]
        self.dice.shuffle(nodes)
        cut = self.dice.randrange(1, len(nodes))
        self.town.net.partition(nodes[:cut], nodes[cut:])
        return True

    def _deafen(self) -> bool:
        """One hears another no more."""
        one, other = self.dice.sample([node.address for node in self.town.nodes.values()], 2)
        self.town.net.cut(one, other, one_way=True)
        return True

    def _heal(self) -> bool:
        self.town.net.paths.calm()
        return True

    def _fill(self) -> bool:
        self.dice.choice(list(self.town.nodes.values())).disk.fill(0)
        return True

    def _empty(self) -> bool:
        for node in self.town.nodes.values():
            node.disk.fill(None)
        return True

    def _pause(self) -> bool:
        self.town.net.pause(self.dice.choice(list(self.town.nodes.values())).address, self.dice.choice([0.5, 3.0]))
        return True

    def _slow(self) -> bool:
        self.dice.choice(list(self.town.nodes.values())).disk.slow(self.dice.choice([0.0, 0.2]))
        return True

    # ---------------------------------------------------------------------------------------------------------- calm

    async def _settle(self) -> None:
        town = self.town
        town.net.calm()
        town.net.set_weather(Weather())
        town.replayed = 0.0
        for node in town.nodes.values():
            if not node.is_wanted:
                await node.gone.wait()
                town.start(node)
        assert await until(self._agrees, CALM_S, look_s=0.5), f"no agreement in {CALM_S} s of calm: {self._disks()}"
        asker = self.dice.choice(list(town.nodes.values()))
        began = town.net.now
        assert asker.log is not None
        asked = town.watch.begins("last", began)
        answer = await asker.log.ask(request_maker("last", asker), 10.0)  # type: ignore[arg-type]
        assert answer.outcome is Outcome.COMMITTED, f"in calm weather: {answer}"
        town.watch.told(asked, answer, town.net.now)
        assert await until(self._agrees, CALM_S, look_s=0.5), f"no agreement after the last request: {self._disks()}"

    def _agrees(self) -> bool:
        """Everybody runs, has one log, and has voted for nothing that is not decided."""
        nodes = self.town.nodes.values()
        if any(node.log is None for node in nodes):
            return False
        logs = {tuple(log_on(node.disk)) for node in nodes}
        return len(logs) == 1 and all(slot_on(node.disk)[1].accepted is None for node in nodes)

    def _disks(self) -> str:
        return "; ".join(f"{node.number}: {len(log_on(node.disk))} decided, {slot_on(node.disk)}" for node in self.town.nodes.values())


def found_after(seeds: int, *, minds_disks: bool = True, first: int = 0) -> tuple[int, str] | None:
    """After how many seeds something is found, and what; None if nothing is."""
    for seed in range(first, first + seeds):
        storm = Storm(seed)
        storm.minds_disks = minds_disks
        try:
            storm.run()
        except (AssertionError, Broken) as broken:
            return seed - first + 1, str(broken)
    return None


def main(first: int, count: int) -> None:
    """Storms by hand; what fails is printed, with its seed."""
    totals: Counter[str] = Counter()
    for seed in range(first, first + count):
        storm = Storm(seed)
        try:
            storm.run()
        except BaseException as broken:
            print(f"seed {seed}: {type(broken).__name__}: {broken}", flush=True)
            if not isinstance(broken, Exception):
                raise
            totals["failed"] += 1
        totals += storm.counts
    print(dict(sorted(totals.items())))


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
