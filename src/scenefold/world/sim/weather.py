"""What the network does to what is sent: values only, the dice come from outside.

Delays have a least value and a long tail: least + typical · u / (1 - u), cut off, for an even u; half of them are below
least + typical. No logarithms: the last digit of one may differ from library to library, and a trace must not.
"""

from __future__ import annotations

import random
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Delay:
    """A distribution of seconds."""

    least_s: float
    typical_s: float
    most_s: float

    def draw(self, dice: random.Random) -> float:
        u = dice.random()
        return min(self.least_s + self.typical_s * u / (1.0 - u), self.most_s)


@dataclass(frozen=True, slots=True)
class Weather:
    """How a path from one machine to another behaves. Odds are per datagram, or per piece of a stream."""

    delay: Delay = Delay(0.0002, 0.0003, 0.05)
    loss: float = 0.0
    """A lost piece of a stream comes `again_s` later, as TCP sends it again."""
    duplication: float = 0.0
    """Datagrams only."""
    reordering: float = 0.0
    """Odds that a datagram is held back, so that later ones overtake it. Streams never reorder."""
    held_back_s: float = 0.2
    again_s: float = 0.2
    bytes_per_s: float = 125e6
    splitting: float = 0.05
    """Odds that a piece of a stream arrives in two: TCP keeps no boundaries."""
    dead_after_s: float = 60.0
    """A stream that gets nothing across for so long is broken for its sender, as by TCP's own patience."""


CALM = Weather()
"""A quiet local network."""
STILL = Weather(Delay(0.0, 0.0, 0.0), splitting=0.0, bytes_per_s=1e15)
"""No delay at all."""


@dataclass(frozen=True, slots=True)
class DatagramFate:
    """When a datagram arrives: never, once, or twice."""

    delays_s: tuple[float, ...]
    held_back: bool = False


LOST = DatagramFate(())


def fate_of_datagram(weather: Weather, dice: random.Random) -> DatagramFate:
    if weather.loss and dice.random() < weather.loss:
        return LOST
    delay, held_back = weather.delay.draw(dice), False
    if weather.reordering and dice.random() < weather.reordering:
        delay, held_back = delay + dice.random() * weather.held_back_s, True
    if weather.duplication and dice.random() < weather.duplication:
        return DatagramFate((delay, weather.delay.draw(dice) + dice.random() * weather.held_back_s), held_back)
    return DatagramFate((delay,), held_back)


def delay_of_piece(weather: Weather, dice: random.Random) -> float:
    """How long a piece of a stream takes, without what its size costs."""
    delay = weather.delay.draw(dice)
    while weather.loss and dice.random() < weather.loss:
        delay += weather.again_s
    return delay
