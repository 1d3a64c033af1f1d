"""What is asked of one run, and what came of it: values that travel between processes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from scenefold.simulation.copying import Copying, draw_copying
from scenefold.simulation.faults import Kind, Schedule
from scenefold.simulation.log_weather import deciders_of, spared
from scenefold.simulation.story import Violation
from scenefold.simulation.weather import STORM_S, Climate, draw

Workload = Literal["data", "members", "all", "keys", "purges", "turns", "logs", "renders"]
WORKLOADS: tuple[Workload, ...] = ("data", "members", "all", "keys", "purges", "turns", "logs", "renders")

OF_CLIENTS: tuple[Workload, ...] = ("logs", "renders")
"""Where clients are cut off, too."""
SPARED = frozenset({Kind.WIPED_DISK, Kind.RESTORED_BACKUP, Kind.CORRUPTION, Kind.LIAR})
"""From these a scene that is to be rendered is spared, each of whose records lies on one disk: what does to data is seen elsewhere."""

OPERATIONS_MIN = 300
FAULTS_MIN = 5
"""A run with fewer acknowledged operations of clients, or fewer faults that took effect, has tested too little."""
COMMITTED_MIN = 50
"""Likewise of entries in the workload `logs`."""
EDITS_MIN, LOOKS_MIN = 10, 12
"""Likewise there of records that were stored, and of those that were read in render mode."""
IMAGES_MIN = 6
"""Likewise of images in the workload `renders`."""


class Renders(NamedTuple):
    """What came of the renders of the workload `renders`.

    `begun_anew`: by their clients, after another job of the same image failed. `attempts_raised`, `nodes_lost`, `nodes_back`, `passes_again` (that were
    traced again), `cells_moved`, `packets_resent` and `late` (packets of an older attempt): within jobs that came to their image.
    `adaptive`, `unattended`: images whose noisy pixels went on for longer, and that came about while their client was away.
    """

    renders: int
    images: int
    failed: int
    interrupted: int
    begun_anew: int
    attempts_raised: int
    nodes_lost: int
    nodes_back: int
    passes_again: int
    cells_moved: int
    packets_resent: int
    late: int
    adaptive: int
    unattended: int


class Proposals(NamedTuple):
    """What became of the entries that clients asked for in the workload `logs`; `taken_over`: decided in a ballot of another one than who began.

    `switches`: changes of mode among the committed ones. `edits`: records that somebody was told are stored; `late`: that were offered
    under a mode that was over, and refused. `looks`: records that were read for an image, in render mode.
    """

    committed: int
    refused: int
    taken_over: int
    switches: int = 0
    edits: int = 0
    late: int = 0
    looks: int = 0


@dataclass(frozen=True, slots=True)
class Order:
    """One seed to be run."""

    seed: int
    nodes: int = 5
    workload: Workload = "all"
    mutant: str | None = None
    storm_s: float = STORM_S
    kinds: tuple[Kind, ...] = ()
    """Of all kinds of faults only these; (): any."""
    keep: tuple[int, ...] | None = None
    """Of the schedule that the seed draws, only the faults with these numbers, from 0; None: all."""
    trace_file: str | None = None
    copies: bool = False
    """Whether some spaces have copies, and nodes and racks may be lost for ever."""
    participants: int | None = None
    """How many decide the scene's log, in the workload `logs`; 0: its origin alone; None: as the seed says."""
    voters: int = 1
    """How many decide the cluster's log; 1: the first one alone, by the log's key."""
    until: str = ""
    """A law: once it is violated the run ends, for whoever wants to know no more; "": it goes on."""

    @property
    def deciders(self) -> int:
        """How many participants the scene begins with."""
        return deciders_of(self.seed) if self.participants is None else self.participants

    @property
    def copying(self) -> Copying | None:
        """How copies are kept, if any are."""
        return draw_copying(self.seed) if self.copies else None

    @property
    def schedule(self) -> Schedule:
        """What will go wrong."""
        whole = draw(self.seed, self.climate)
        if self.workload == "logs":
            whole = spared(whole, self.deciders)
        if self.workload == "renders":
            whole = tuple(fault for fault in whole if fault.kind not in SPARED)
        if self.voters > 1:
            # No voter may be put back to an earlier state (specs/26-modes.md, A voter's own disk).
            whole = tuple(fault for fault in whole if fault.kind is not Kind.RESTORED_BACKUP)
        return whole if self.keep is None else tuple(whole[number] for number in self.keep)

    @property
    def climate(self) -> Climate:
        mostly = self.workload == "members"
        return Climate(
            self.nodes,
            members=self.workload != "data",
            mostly_members=mostly,
            storm_s=self.storm_s,
            kinds=self.kinds,
            copying=self.copying,
            of_clients=self.workload in OF_CLIENTS,
            of_renders=self.workload == "renders",
        )

    @property
    def replay(self) -> str:
        """The command that shows this run again."""
        words = [f"python -m scenefold.simulation --nodes {self.nodes} --replay {self.seed}"]
        if self.workload != "all":
            words.append(f"--workload {self.workload}")
        if self.participants is not None:
            words.append(f"--participants {self.participants}")
        if self.voters > 1:
            words.append(f"--voters {self.voters}")
        if self.copies:
            words.append("--copies")
        if self.storm_s != STORM_S:
            words.append(f"--seconds {self.storm_s:g}")
        if self.kinds:
            words.append(f"--faults '{','.join(kind.value for kind in self.kinds)}'")
        if self.mutant is not None:
            words.append(f"--mutant '{self.mutant}'")
        if self.keep is not None:
            words.append(f"--keep {','.join(map(str, self.keep)) or 'none'}")
        return " ".join(words)


@dataclass(frozen=True, slots=True)
class Result:
    """What a run came to. `counts`: how often what happened, for people; `faults`: those that took effect, by kind."""

    order: Order
    schedule: Schedule
    violations: tuple[Violation, ...]
    faults: dict[str, int]
    operations: int
    trace_hash: str
    virtual_s: float
    cpu_s: float
    counts: dict[str, int] = field(default_factory=dict)
    reported: dict[str, int] = field(default_factory=dict)
    """What lying nodes achieved that nobody could prevent, by manner: no violations, and never silent."""
    story: str = ""
    """Told only if something was violated."""
    proposals: Proposals | None = None
    """In the workload `logs`."""
    renders: Renders | None = None
    """In the workload `renders`."""

    @property
    def shortage(self) -> str:
        """What a whole run lacks to be a test of anything; "" if nothing. With faults left out, or broken off, it may be short."""
        if self.violations or self.order.keep is not None:
            return ""
        faults = sum(self.faults.values())
        worked = (self.operations, OPERATIONS_MIN, "acknowledged operations")
        if self.proposals is not None:
            worked = (self.proposals.committed, COMMITTED_MIN, "committed proposals")
        if self.renders is not None:
            worked = (self.renders.images, IMAGES_MIN, "images")
        found = [worked, (faults, FAULTS_MIN, "faults")]
        if self.proposals is not None:
            found += [(self.proposals.edits, EDITS_MIN, "edits"), (self.proposals.looks, LOOKS_MIN, "records read for images")]
        return ", ".join(f"{count} {what} of {wanted} at least" for count, wanted, what in found if count < wanted)
