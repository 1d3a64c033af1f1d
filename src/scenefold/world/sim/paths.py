"""Which machine reaches which, and how well: the network's state between the faults. Values only, no tasks.

Cuts count: a path that two faults cut is whole when both have ended. Everything costs memory only where it differs
from the rule, so that a thousand machines and their million paths are no trouble.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass

from scenefold.world.sim.weather import CALM, Weather

Path = tuple[str, str]


@dataclass(frozen=True, slots=True, eq=False)
class Partition:
    """Machines in different groups do not reach each other; a machine in no group reaches everybody."""

    group_of: dict[str, int]

    def separates(self, source: str, target: str) -> bool:
        one, other = self.group_of.get(source), self.group_of.get(target)
        return one is not None and other is not None and one != other


class Paths:
    """The state of all paths."""

    def __init__(self, weather: Weather = CALM) -> None:
        self.weather = weather
        """Of every path that has none of its own."""
        self._own_weather: dict[Path, Weather] = {}
        self._cuts: Counter[Path] = Counter()
        self._partitions: list[Partition] = []
        self._clogs: dict[Path, float] = {}
        self._slow: dict[str, float] = {}

    def is_cut(self, source: str, target: str) -> bool:
        if self._cuts and (source, target) in self._cuts:
            return True
        return any(partition.separates(source, target) for partition in self._partitions)

    def weather_of(self, source: str, target: str) -> Weather:
        return self._own_weather.get((source, target), self.weather) if self._own_weather else self.weather

    def factor(self, source: str, target: str) -> float:
        """How many times longer everything takes on a path, for the sake of its ends."""
        return max(self.slowness(source), self.slowness(target)) if self._slow else 1.0

    def slowness(self, machine: str) -> float:
        return self._slow.get(machine, 1.0)

    def bytes_per_s(self, source: str, target: str) -> float:
        rate = self.weather_of(source, target).bytes_per_s
        return min(rate, self._clogs.get((source, target), rate)) if self._clogs else rate

    def set_weather(self, weather: Weather | None, source: str, target: str) -> None:
        if weather is None:
            self._own_weather.pop((source, target), None)
        else:
            self._own_weather[source, target] = weather

    def cut(self, source: str, target: str) -> None:
        self._cuts[source, target] += 1

    def mend(self, source: str, target: str) -> None:
        self._cuts[source, target] -= 1
        if self._cuts[source, target] <= 0:
            del self._cuts[source, target]

    def divide(self, groups: Collection[Collection[str]]) -> Partition:
        partition = Partition({machine: number for number, group in enumerate(groups) for machine in group})
        self._partitions.append(partition)
        return partition

    def unite(self, partition: Partition) -> None:
        if partition in self._partitions:
            self._partitions.remove(partition)

    def clog(self, source: str, target: str, bytes_per_s: float) -> None:
        self._clogs[source, target] = bytes_per_s

    def unclog(self, source: str, target: str) -> None:
        self._clogs.pop((source, target), None)

    def slow(self, machine: str, factor: float) -> None:
        if factor == 1.0:
            self._slow.pop(machine, None)
        else:
            self._slow[machine] = factor

    def calm(self) -> None:
        """End every cut, partition, clog and slowness. The weather stays."""
        self._cuts.clear()
        self._partitions.clear()
        self._clogs.clear()
        self._slow.clear()
