"""The real world: Trio's sockets, TLS 1.3, threads, the system's clock and randomness. The twin of a simulated one."""

from scenefold.world.real.world import DEFAULT_LANES, newcomer_world, offline_world, real_world

__all__ = ["DEFAULT_LANES", "newcomer_world", "offline_world", "real_world"]
