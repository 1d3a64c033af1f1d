"""How one node is to run: its place in the cluster, its folders, what it may use."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from scenefold.base.errors import UsageFault
from scenefold.base.ids import checked_node_id
from scenefold.base.limits import BLACKLIST_MAX
from scenefold.base.location import Location
from scenefold.base.prefixes import AddressPrefix, address_prefix
from scenefold.peer.timing import REMOVE_AFTER_S, T_WAIT_S

SEED_WAIT_S = 30.0
"""A seed that is being started beside us needs a few seconds; one that is silent for longer is not there."""
THREADS_MAX = 1_024
SCRUB_DAYS = 30.0
SCRUB_DAYS_MAX = 3_650.0
SCRUB_BYTES_PER_S = 16 * 1024 * 1024
"""A tenth of what a slow disk reads."""
TRANSFER_BYTES_PER_S = 64 * 1024 * 1024
"""Of handovers and strays together: half of a gigabit link, so that reads and writes keep the other half."""

Place = Literal["loaded", "random"] | Location
"""Where a newcomer stands: beside the most loaded node, anywhere, or where it is told to."""


def processors() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def machine_memory_bytes() -> int:
    """Memory that this machine has."""
    return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeSettings:
    """Settings of one node. `seeds` empty: those of the profile. `memory_bytes` 0: half of the machine's.

    `capacity_bytes`: what the node may store, 0: what the disk holds. `remove_after_s`: nobody is removed who was heard
    within this time. `transfer_bytes_per_s`: bound on moving data. `blacklist`: addresses, and prefixes of some, of nodes
    that must not hold copies of this node's data. `scrub_days`: in this time all records are read again, unless that needs more
    than `scrub_bytes_per_s`. `balance`: whether this node moves its bounds by itself.
    """

    profile_folder: Path
    address: str
    data_folder: Path
    seeds: tuple[str, ...] = ()
    seed_wait_s: float = SEED_WAIT_S
    memory_bytes: int = 0
    capacity_bytes: int = 0
    render_threads: int = 1
    remove_after_s: float = REMOVE_AFTER_S
    transfer_bytes_per_s: int = TRANSFER_BYTES_PER_S
    blacklist: tuple[str, ...] = ()
    scrub_days: float = SCRUB_DAYS
    scrub_bytes_per_s: int = SCRUB_BYTES_PER_S
    join_place: Place = "loaded"
    balance: bool = True
    log_format: Literal["console", "json"] = "console"
    log_level: Literal["debug", "info", "warning", "error"] = "info"

    def __post_init__(self) -> None:
        if not 1 <= self.render_threads <= THREADS_MAX:
            raise UsageFault(f"{self.render_threads} render threads", remedy=f"give a number from 1 to {THREADS_MAX}")
        if self.memory_bytes < 0 or self.capacity_bytes < 0 or self.seed_wait_s <= 0:
            raise UsageFault("memory, capacity and seconds to wait cannot be negative", remedy="leave them at their defaults")
        if not self.remove_after_s >= T_WAIT_S:
            raise UsageFault(f"removal after {self.remove_after_s:g} s", remedy=f"give at least {T_WAIT_S:g}, the time that a lease lasts")
        if self.transfer_bytes_per_s < 1:
            raise UsageFault(f"transfers of {self.transfer_bytes_per_s} bytes a second", remedy="give at least 1")
        if not 0 < self.scrub_days <= SCRUB_DAYS_MAX:
            raise UsageFault(f"a scrub of {self.scrub_days:g} days", remedy=f"give more than 0, and {SCRUB_DAYS_MAX:g} at most")
        if self.scrub_bytes_per_s < 1:
            raise UsageFault(f"a scrub of {self.scrub_bytes_per_s} bytes a second", remedy="give at least 1")
        if len(self.blacklist) > BLACKLIST_MAX:
            raise UsageFault(f"a blacklist of {len(self.blacklist)} entries", remedy=f"give {BLACKLIST_MAX} at most")

        for address in (self.address, *self.seeds):
            try:
                checked_node_id(address)
            except ValueError as problem:
                raise UsageFault(f"{problem}", remedy="give one such as 192.168.1.20") from None
        for listed in self.blacklist:
            try:
                address_prefix(listed)
            except ValueError as problem:
                raise UsageFault(f"{problem}", remedy="give an address such as 192.168.1.20, or a prefix such as 192.168.1.0/24") from None

    @property
    def memory_budget_bytes(self) -> int:
        """What the node may use of the machine's memory."""
        return self.memory_bytes or machine_memory_bytes() // 2

    @property
    def blacklisted(self) -> tuple[AddressPrefix, ...]:
        """The blacklist's prefixes, in order, each once."""
        return tuple(sorted(set(map(address_prefix, self.blacklist))))

    @classmethod
    def for_member(cls, profile_folder: Path, address: str, *, data: Path | None = None, threads: int | None = None) -> NodeSettings:
        """The usual settings of a member: data in the user's data folder, a thread for every processor."""
        return cls(
            profile_folder=profile_folder,
            address=address,
            data_folder=data if data is not None else default_data_folder(profile_folder, address),
            render_threads=threads if threads is not None else processors(),
        )


def place_of(text: str) -> Place:
    """A place as it is written: "loaded", "random", or a location by its leading hexadecimal digits. UsageFault of anything else."""
    if text == "loaded":
        return "loaded"
    if text == "random":
        return "random"
    try:
        return Location.from_digits(text)
    except ValueError:
        raise UsageFault(
            f"{text[:80]!r} is no place on the line",
            remedy='give "loaded", "random", or 1 to 40 hexadecimal digits, 8 for the middle',
        ) from None


def default_data_folder(profile_folder: Path, address: str) -> Path:
    """Where a node keeps its records if nobody says otherwise."""
    import platformdirs

    name = profile_folder.resolve().name
    return Path(platformdirs.user_data_path("scenefold", appauthor=False)) / name / address
