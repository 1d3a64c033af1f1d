"""Who could be heard by whom, over time: the judge of removals (specs/17-simulation.md, Laws). Pure.

A removal is false if the node was up, under the incarnation that was removed, and could be reached all through the second
half of the time that it must be silent for: by the voter itself, or by another node that the voter could reach. Loss is not
counted as being cut off: that nobody is removed under loss alone is what this is to find out.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field


@dataclass(slots=True)
class Spells:
    """When something was so: `[begin, end)` in seconds, the last one open while it still is."""

    spans: list[tuple[float, float]] = field(default_factory=list)
    since_s: float | None = None

    def begin(self, now_s: float) -> None:
        if self.since_s is None:
            self.since_s = now_s

    def end(self, now_s: float) -> None:
        if self.since_s is not None and now_s > self.since_s:
            self.spans.append((self.since_s, now_s))
        self.since_s = None

    def within(self, first_s: float, last_s: float) -> list[tuple[float, float]]:
        """The parts of this that lie in a window that ends now."""
        every = [*self.spans, *([] if self.since_s is None else [(self.since_s, last_s)])]
        parts = [(max(begin, first_s), min(end, last_s)) for begin, end in every]
        return [(begin, end) for begin, end in parts if end > begin]


class Reach:
    """Who was down and which pairs were cut, fed as it happens. Slots are small numbers."""

    def __init__(self) -> None:
        self._down: dict[int, Spells] = {}
        self._cut: dict[tuple[int, int], Spells] = {}
        self._cuts_open: dict[tuple[int, int], int] = {}
        self._hampered: dict[int, Spells] = {}
        self._burdens: dict[int, int] = {}

    def goes_down(self, slot: int, now_s: float) -> None:
        self._down.setdefault(slot, Spells()).begin(now_s)

    def comes_up(self, slot: int, now_s: float) -> None:
        self._down.setdefault(slot, Spells()).end(now_s)

    def cut(self, one: int, other: int, now_s: float) -> None:
        """The two cannot have a conversation any more, one way or both; may be said several times."""
        pair = (min(one, other), max(one, other))
        self._cuts_open[pair] = self._cuts_open.get(pair, 0) + 1
        self._cut.setdefault(pair, Spells()).begin(now_s)

    def mended(self, one: int, other: int, now_s: float) -> None:
        """One of the cuts between the two has ended."""
        pair = (min(one, other), max(one, other))
        self._cuts_open[pair] = self._cuts_open.get(pair, 0) - 1
        if self._cuts_open[pair] <= 0:
            self._cuts_open[pair] = 0
            self._cut.setdefault(pair, Spells()).end(now_s)

    def hampered(self, slot: int, now_s: float) -> None:
        """The machine works on, but badly; may be said several times."""
        self._burdens[slot] = self._burdens.get(slot, 0) + 1
        self._hampered.setdefault(slot, Spells()).begin(now_s)

    def relieved(self, slot: int, now_s: float) -> None:
        """One of its burdens is gone."""
        self._burdens[slot] -= 1
        if not self._burdens[slot]:
            self._hampered[slot].end(now_s)

    def was_clear(self, one: int, other: int, window: tuple[float, float]) -> bool:
        """Whether both were up and well, and could talk with each other, during all of the window."""
        burdens = [self._hampered.get(slot) for slot in (one, other)]
        return self._is_clear((one, other), ((one, other),), window) and not any(
            spell.within(*window) for spell in burdens if spell is not None
        )

    def was_reachable(self, slot: int, voter: int, others: Sequence[int], window: tuple[float, float]) -> bool:
        """Whether the voter, or one other node that it reached throughout, could talk with the slot during all of the window."""
        if self._is_clear((slot, voter), ((slot, voter),), window):
            return True
        between = (other for other in others if other not in (slot, voter))
        return any(self._is_clear((slot, voter, other), ((slot, other), (other, voter)), window) for other in between)

    def _is_clear(self, up: Iterable[int], pairs: Iterable[tuple[int, int]], window: tuple[float, float]) -> bool:
        spells = [self._down.get(slot) for slot in up]
        spells += [self._cut.get((min(pair), max(pair))) for pair in pairs]
        return not any(spell.within(*window) for spell in spells if spell is not None)
