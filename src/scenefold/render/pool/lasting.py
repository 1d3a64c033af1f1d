"""What a node's part in a job keeps from one attempt to the next (specs/31-attempts.md): its films, and what it did."""

from __future__ import annotations

from dataclasses import dataclass, field

from scenefold.render.pool.films import Films
from scenefold.render.pool.hit_sample import HitSample


@dataclass(slots=True)
class MemberStatistics:
    """What a node did for a job so far."""

    rays: int = 0
    """Born here: camera, bounce and shadow rays, each once however many cells it crosses."""
    casts: int = 0
    """Visits of this cell: the node's work."""
    shadow_casts: int = 0
    rays_sent: int = 0
    rays_received: int = 0
    busy_seconds: float = 0.0
    counters: list[int] = field(default_factory=lambda: [0, 0, 0])
    late: int = 0
    """Packets of older attempts, which were refused."""


@dataclass(frozen=True, slots=True)
class Lasting:
    """Of a node's part, what goes on from one attempt to the next."""

    films: Films
    statistics: MemberStatistics
    hits: HitSample
