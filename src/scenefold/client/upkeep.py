"""What a node does by itself with records, and an administrator may pause or slow down (specs/21-verify.md, Upkeep)."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, TypedDict, Unpack

from scenefold.base.errors import UsageFault
from scenefold.client.calls import Calls
from scenefold.wire import ChangeUpkeep, UpkeepChanged
from scenefold.wire.upkeep_packets import BALANCE, REPAIR, SCRUB
from scenefold.world import Priority

DUTIES = {"repair": REPAIR, "scrub": SCRUB, "balance": BALANCE}
RATE_MAX = (1 << 63) - 1


@dataclass(frozen=True, slots=True)
class Upkeep:
    """As it is durable at a node. `paused`: names of duties."""

    paused: tuple[str, ...]
    transfer_bytes_per_s: int
    """Of everything that the node moves: repair, handovers, draining."""
    scrub_bytes_per_s: int

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        rates = {"transfer_bytes_per_s": self.transfer_bytes_per_s, "scrub_bytes_per_s": self.scrub_bytes_per_s}
        return {"paused": list(self.paused), **rates}


class UpkeepChanges(TypedDict, total=False):
    """What is to be changed. Duties by name, "repair", "scrub" and "balance"; a rate of 0: what the node was started with."""

    pause: Collection[str]
    resume: Collection[str]
    transfer_bytes_per_s: int | None
    scrub_bytes_per_s: int | None


async def change_upkeep(calls: Calls, address: str, **changes: Unpack[UpkeepChanges]) -> Upkeep:
    """Have a node pause duties, go on with others, keep to other rates. Gives what then counts."""
    pause, resume = changes.get("pause", ()), changes.get("resume", ())
    transfer, scrub = changes.get("transfer_bytes_per_s"), changes.get("scrub_bytes_per_s")
    both = sorted(set(pause) & set(resume))
    if both:
        raise UsageFault(f"{', '.join(both)} cannot be paused and resumed at once", where=address, remedy="choose")
    unknown = sorted({*pause, *resume} - DUTIES.keys())
    if unknown:
        raise UsageFault(f"a node has no duty {unknown[0]!r}", where=address, remedy=f"choose of {', '.join(DUTIES)}")
    for rate in (transfer, scrub):
        if rate is not None and not 0 <= rate <= RATE_MAX:
            raise UsageFault(
                f"a rate of {rate} bytes a second", where=address, remedy="give at least 1, or 0 for what the node was started with"
            )
    order = ChangeUpkeep(_bits({*pause, *resume}), _bits(pause), transfer, scrub)
    reply = await calls.ask(address, order, UpkeepChanged, priority=Priority.HIGH)
    paused = tuple(name for name, bit in DUTIES.items() if reply.paused & bit)
    return Upkeep(paused, reply.transfer_bytes_per_s, reply.scrub_bytes_per_s)


def _bits(names: Collection[str]) -> int:
    return sum(DUTIES[name] for name in set(names))
