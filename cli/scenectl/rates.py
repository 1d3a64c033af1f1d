"""How fast a verb may read, as people give it: MiB a second."""

from __future__ import annotations

from scenefold.base.errors import UsageFault

RATES = 0.001, 1_000_000.0


def bytes_per_s(rate: float | None) -> float | None:
    """None: as fast as it goes. UsageFault for what is no rate."""
    if rate is not None and not RATES[0] <= rate <= RATES[1]:
        raise UsageFault(f"a rate of {rate:g} MiB/s", where="--rate", remedy="give a number from 0.001 to 1000000")
    return None if rate is None else rate * 2**20
