"""How fast a node is, by what it took for this and that. Pure."""

from __future__ import annotations

_KEPT = 0.5
"""Of older measurements, at each new one."""
_SOUND_RAYS = 8_192
"""A measurement that says that a node is slower than it was counts less if it is of fewer rays: what it took is mostly the way there and back."""
_SHORTEST_S = 1e-3
"""Time is not measured better than that."""
_RECOVERED = 4.0
"""Times as quick as it was: what was before says nothing any more."""


class Pace:
    """Rays a second: sums of both, of which older ones fade."""

    def __init__(self) -> None:
        self._rays, self._seconds = 0.0, 0.0

    @property
    def value(self) -> float | None:
        """None before anything was measured."""
        return self._rays / self._seconds if self._seconds else None

    def add(self, rays: int, seconds: float, *, is_alone: bool = False) -> None:
        """So many took so long. `is_alone`: nothing else was done in that time, or before in place of it."""
        seconds, known = max(seconds, _SHORTEST_S), self.value
        quicker = rays / seconds / known if known else 1.0
        if is_alone and quicker > _RECOVERED:
            self._rays, self._seconds = float(rays), seconds
            return
        weight = min(1.0, rays / _SOUND_RAYS) if quicker < 1.0 else 1.0
        kept = 1.0 - (1.0 - _KEPT) * weight
        self._rays, self._seconds = kept * self._rays + weight * rays, kept * self._seconds + weight * seconds
