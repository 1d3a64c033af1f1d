"""How one node is to run: its place in the cluster, its folders, what it may use."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from scenefold.base.errors import UsageFault
from scenefold.base.ids import node_id_of

SEED_WAIT_S = 30.0
"""A seed that is being started beside us needs a few seconds; one that is silent for longer is not there."""
THREADS_MAX = 1_024


def processors() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def machine_memory_bytes() -> int:
    """Memory that this machine has."""
    return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeSettings:
    """Settings of one node. `seeds` empty: those of the profile. `memory_bytes` 0: half of the machine's."""

    profile_folder: Path
    address: str
    data_folder: Path
    seeds: tuple[str, ...] = ()
    seed_wait_s: float = SEED_WAIT_S
    memory_bytes: int = 0
    render_threads: int = 1
    log_format: Literal["console", "json"] = "console"
    log_level: Literal["debug", "info", "warning", "error"] = "info"

    def __post_init__(self) -> None:
        if not 1 <= self.render_threads <= THREADS_MAX:
            raise UsageFault(f"{self.render_threads} render threads", remedy=f"give a number from 1 to {THREADS_MAX}")
        if self.memory_bytes < 0 or self.seed_wait_s <= 0:
            raise UsageFault("memory and seconds to wait cannot be negative", remedy="leave them at their defaults")

        for address in (self.address, *self.seeds):
            try:
                node_id_of(address)
            except ValueError:
                raise UsageFault(f"{address!r} is no IPv4 address", remedy="give one such as 192.168.1.20") from None

    @property
    def memory_budget_bytes(self) -> int:
        """What the node may use of the machine's memory."""
        return self.memory_bytes or machine_memory_bytes() // 2

    @classmethod
    def for_member(cls, profile_folder: Path, address: str, *, data: Path | None = None, threads: int | None = None) -> NodeSettings:
        """The usual settings of a member: data in the user's data folder, a thread for every processor."""
        return cls(
            profile_folder=profile_folder,
            address=address,
            data_folder=data if data is not None else default_data_folder(profile_folder, address),
            render_threads=threads if threads is not None else processors(),
        )


def default_data_folder(profile_folder: Path, address: str) -> Path:
    """Where a node keeps its records if nobody says otherwise."""
    import platformdirs

    name = profile_folder.resolve().name
    return Path(platformdirs.user_data_path("scenefold", appauthor=False)) / name / address
