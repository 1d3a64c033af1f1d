"""Records that have rotted, as the store meets them: counted, and told of each place once a minute at most.

Whoever asks for such a record, or writes where it lies and is refused, leaves it as it is, and may do so as often as he likes.
"""

from __future__ import annotations

import logging
from collections.abc import Callable

from scenefold.store.layout import Spot
from scenefold.world.ports import Clock
from scenefold.world.quiet import QuietLog


class Noticed:
    """What one store has met since it was opened."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._quiet = QuietLog(logging.getLogger("scenefold.store"), logging.ERROR)
        self.count = 0
        """Reads and writes that met a record which had changed on the disk."""
        self.hear: Callable[[Spot], None] = _nobody_hears
        """Called for each record that cannot be read; must return at once."""

    def read(self, spot: Spot, problem: str) -> None:
        self._met(spot, "read", problem)
        self.hear(spot)

    def written_over(self, spot: Spot) -> None:
        """A write was judged by what is left of the record there."""
        self._met(spot, "write", "a damaged record, whose header has changed on the disk, is in the way of another")

    def _met(self, spot: Spot, kind: str, text: str) -> None:
        self.count += 1
        (scene, space, location), name = spot
        # An object is wherever its node put it: its name says which one it is.
        what = f"object {name.hex()}" if name else location.hex()
        self._quiet.say(self._clock.now(), f"scene {scene:08x}, space {space}, {what}", kind, text)


def _nobody_hears(_spot: Spot) -> None:
    """It is met again."""
