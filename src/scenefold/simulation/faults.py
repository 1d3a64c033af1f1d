"""What can go wrong in a simulation, each as a value: it can be listed, replayed and left out (specs/17-simulation.md, Faults).

A fault has a beginning and an end in virtual seconds, says whom it hits by *slot* (founders are 0 … N-1, and 0 is the
voter; spares that may join follow), and how much. What `slots` and `amount` mean depends on the kind; see KINDS.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Kind(Enum):
    """Kinds of faults; the value is the name in reports."""

    PARTITION = "partition"
    ONE_WAY = "one-way cut"
    CLOG = "clogged link"
    LOSS = "loss"
    DUPLICATION = "duplication"
    REORDERING = "reordering"
    SLOW_NODE = "slow node"
    PAUSE = "paused node"
    RESET = "connection reset"
    CRASH = "crash"
    CRASH_BEFORE_COMMIT = "crash before commit"
    CRASH_AFTER_COMMIT = "crash after commit"
    CRASH_BEFORE_SEND = "crash before send"
    CRASH_AFTER_SEND = "crash after send"
    TORN_WRITE = "torn write"
    DISK_FULL = "full disk"
    SLOW_DISK = "slow disk"
    CORRUPTION = "corrupted page"
    WIPED_DISK = "wiped disk"
    RESTORED_BACKUP = "restored backup"
    CLOCK_RATE = "clock rate"
    CLOCK_OFFSET = "clock offset"
    JOIN = "join"
    DRAIN = "drain"
    KILL_IN_JOIN = "kill during join"
    KILL_IN_HANDOVER = "kill during handover"
    REPLAY = "replayed datagrams"
    LIAR = "lying node"
    LOST_NODES = "lost nodes"
    LOST_RACK = "lost rack"
    ROT_ON_SEVERAL = "rot on several nodes"
    CUT_IN_REPAIR = "partition in repair"
    LYING_HOLDER = "lying holder"
    BLACKLIST = "changed blacklist"
    CUT_CLIENT = "cut-off client"
    PAUSED_CLIENT = "paused client"
    CLIENT_RATE = "client's clock rate"
    KILL_IN_RENDER = "kill during render"
    POWER = "power failure"
    SLEEP = "common sleep"


CLIENTS = 4
"""At work in a run; their machines have numbers from 0."""
VOTER = 0
"""Its slot."""
HANDOVER_STEPS = 5
"""Durable ones: offered, noted, released, taken, given. The number of one, or that of it and all of them together, is an amount."""
TAKEN = 4


class Whom(Enum):
    """Whom a fault hits."""

    ALL = "all"
    """Every link; `slots` is empty."""
    GROUP = "group"
    """Some slots, fewer than half, against all others."""
    PAIR = "pair"
    """Two slots, in this order; every other time the voter is one of them."""
    ONE = "one"
    NO_VOTER = "no voter"
    """One slot, but never the voter: with one voter for now, its disk is the cluster's log."""
    SEVERAL = "several"
    """Two slots or more."""
    COPIES = "fewer than copies"
    """One slot or more, never the voter, and never as many as a space with copies has."""
    RACK = "rack"
    """All slots of a rack, which is not the voter's."""
    CLIENT = "client"
    """One client; `slots` is its number."""
    SPARE = "spare"
    """A spare of its own, that no other fault starts."""


@dataclass(frozen=True, slots=True)
class Shape:
    """How faults of a kind are drawn. `odds`: how many a seed has on average; no kind is in all seeds (weather.py). `amount`: see `meaning`."""

    odds: float
    whom: Whom
    seconds: tuple[float, float]
    amount: tuple[float, float] = (0.0, 0.0)
    meaning: str = ""
    long_odds: float = 0.0
    """Of lasting nearly as long as it may, from early on."""
    moves_members: bool = False
    """Whether the fault is one of membership, and left out of the workload `data`."""
    of_copies: bool = False
    """Whether it is only for runs that keep copies."""
    of_clients: bool = False
    """Whether it hits a client, and is only for the workloads `logs` and `renders`."""
    of_renders: bool = False
    """Whether it is only for the workload `renders`."""
    is_later: bool = False
    """Whether it has dice of its own, so that all else in a seed stayed as it was when it came."""


KINDS: dict[Kind, Shape] = {
    Kind.PARTITION: Shape(0.66, Whom.GROUP, (2, 70), long_odds=0.2),
    Kind.ONE_WAY: Shape(0.78, Whom.PAIR, (2, 60), long_odds=0.5),
    Kind.CLOG: Shape(0.76, Whom.PAIR, (2, 40)),
    Kind.LOSS: Shape(0.66, Whom.ALL, (5, 40), (0.02, 0.3), "share of datagrams lost"),
    Kind.DUPLICATION: Shape(0.66, Whom.ALL, (5, 40), (0.02, 0.3), "share of datagrams doubled"),
    Kind.REORDERING: Shape(0.66, Whom.ALL, (3, 20), (0.05, 1.5), "seconds that a datagram may be late"),
    Kind.SLOW_NODE: Shape(0.7, Whom.ONE, (3, 20), (10, 400), "times as slow"),
    Kind.PAUSE: Shape(0.75, Whom.ONE, (1, 60), long_odds=0.3),
    Kind.RESET: Shape(0.74, Whom.PAIR, (0.5, 4), (1, 4), "resets, spread over the time"),
    Kind.CRASH: Shape(0.7, Whom.ONE, (0.5, 60), (0, 1), "above 0.5 its machine vanishes silently", long_odds=0.2),
    Kind.CRASH_BEFORE_COMMIT: Shape(1.55, Whom.ONE, (1, 15), (1, 5), "which commit from then on"),
    Kind.CRASH_AFTER_COMMIT: Shape(1.6, Whom.ONE, (1, 15), (1, 5), "which commit from then on"),
    Kind.CRASH_BEFORE_SEND: Shape(0.98, Whom.ONE, (1, 15), (1, 40), "which packet from then on"),
    Kind.CRASH_AFTER_SEND: Shape(1.02, Whom.ONE, (1, 15), (1, 40), "which packet from then on"),
    Kind.TORN_WRITE: Shape(1.15, Whom.ONE, (1, 15)),
    Kind.DISK_FULL: Shape(
        0.76,
        Whom.ONE,
        (3, 60),
        (0, 1),
        "above 0.5 no byte is free; above 0.75 that begins when a stray lies there, which rots",
        long_odds=0.2,
    ),
    Kind.SLOW_DISK: Shape(0.66, Whom.ONE, (3, 60), (0.05, 1.0), "seconds a commit", long_odds=0.2),
    Kind.CORRUPTION: Shape(0.7, Whom.ONE, (0, 0), (1, 3), "records"),
    Kind.WIPED_DISK: Shape(0.72, Whom.NO_VOTER, (0.5, 8)),
    Kind.RESTORED_BACKUP: Shape(1.65, Whom.NO_VOTER, (5, 20)),
    Kind.CLOCK_RATE: Shape(0.66, Whom.ONE, (10, 60), (-0.009, 0.009), "rate error; consensus assumes at most 1 %", long_odds=0.2),
    Kind.CLOCK_OFFSET: Shape(0.66, Whom.ONE, (0, 0), (-3600, 3600), "seconds that the time of day jumps"),
    Kind.JOIN: Shape(0.7, Whom.SPARE, (0, 0), moves_members=True),
    Kind.DRAIN: Shape(0.78, Whom.NO_VOTER, (5, 30), (0, 1), "above 0.5 it comes back as a newcomer", moves_members=True),
    Kind.KILL_IN_JOIN: Shape(0.84, Whom.SPARE, (1, 15), (1, 11), "which commit of the joiner", moves_members=True),
    Kind.KILL_IN_HANDOVER: Shape(
        0.84,
        Whom.ALL,
        (2, 60),
        (1, 2 * HANDOVER_STEPS),
        f"which step of any handover; {HANDOVER_STEPS} more: its peer dies",
        0.3,
        moves_members=True,
    ),
    Kind.REPLAY: Shape(0.66, Whom.ALL, (5, 40), (2, 40), "datagrams a second, of those sent lately"),
    Kind.LIAR: Shape(
        0.72,
        Whom.ONE,
        (10, 70),
        (1, 12),
        "what it lies in: reads, acknowledgements, handovers, statuses, tables, headers; above 6 in all",
        long_odds=0.3,
    ),
    Kind.LOST_NODES: Shape(0.6, Whom.COPIES, (0.5, 20), (0, 1), "above 0.6 for ever; else they come back empty", of_copies=True),
    Kind.LOST_RACK: Shape(
        0.5, Whom.RACK, (0.5, 20), (0, 1), "above 0.6 for ever; below 0.3 they come back with their disks, else empty", of_copies=True
    ),
    Kind.ROT_ON_SEVERAL: Shape(0.5, Whom.SEVERAL, (0, 0), (1, 4), "records on each", of_copies=True),
    Kind.CUT_IN_REPAIR: Shape(0.6, Whom.GROUP, (2, 30), of_copies=True),
    Kind.LYING_HOLDER: Shape(0.5, Whom.ONE, (10, 70), long_odds=0.3, of_copies=True),
    Kind.BLACKLIST: Shape(
        0.6,
        Whom.ONE,
        (3, 60),
        (0, 1),
        "what else it forbids: below 0.4 one founder, below 0.7 the block that one stands in, else every node",
        long_odds=0.3,
        of_copies=True,
    ),
    Kind.CUT_CLIENT: Shape(1.3, Whom.CLIENT, (1, 40), (0, 1), "above 0.5 from all nodes, else from this share of them", of_clients=True),
    Kind.PAUSED_CLIENT: Shape(1.3, Whom.CLIENT, (1, 40), of_clients=True),
    Kind.CLIENT_RATE: Shape(0.66, Whom.CLIENT, (10, 60), (-0.009, 0.009), "rate error; leases assume at most 1 %", of_clients=True),
    Kind.KILL_IN_RENDER: Shape(
        2.4,
        Whom.ONE,
        (0.5, 60),
        (1, 200),
        "which packet of a render from then on; even: once it is handled",
        long_odds=0.2,
        of_renders=True,
    ),
    Kind.POWER: Shape(0.4, Whom.ALL, (0.5, 20), (0, 10), "seconds over which they start again", is_later=True),
    Kind.SLEEP: Shape(0.4, Whom.ALL, (0, 0), (20, 40_000), "seconds that all machines sleep", is_later=True),
}


@dataclass(frozen=True, slots=True)
class Fault:
    """One thing that goes wrong, from `begin_s` until `end_s` (the same for what happens at once)."""

    kind: Kind
    begin_s: float
    end_s: float
    slots: tuple[int, ...] = ()
    amount: float = 0.0

    def __str__(self) -> str:
        span = f"{self.begin_s:6.2f} s" + (f" to {self.end_s:6.2f} s" if self.end_s > self.begin_s else " " * 12)
        shape = KINDS[self.kind]
        who = {Whom.ALL: "", Whom.GROUP: "{} from all others"}.get(shape.whom, "{}")
        kind = "c" if shape.whom is Whom.CLIENT else "n"
        names = (" and " if shape.whom is Whom.PAIR else ", ").join(f"{kind}{slot}" for slot in self.slots)
        much = f"{self.amount:.4g} ({shape.meaning})" if shape.meaning else ""
        return f"{span}  {self.kind.value:<21} {who.format(names):<22} {much}".rstrip()


Schedule = tuple[Fault, ...]
"""All faults of a run, in the order of their beginnings."""
