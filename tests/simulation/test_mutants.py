"""If this fails, a safeguard can break and the simulation does not notice: there is a hole in the simulation, or in the mutant.

Each mutant is looked for in a climate that provokes it: few kinds of faults, in a short storm. How soon the general weather finds
it is measured (docs/benchmarks.md), not tested. The product as it is must hold in the same climates.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import pytest

from scenefold.simulation import laws
from scenefold.simulation.faults import Kind
from scenefold.simulation.mutants import MUTANTS
from scenefold.simulation.outcome import Order, Workload
from scenefold.simulation.run import run
from simulation.runs import fail_with_stories

SEEDS = range(18)
"""One of them must find a mutant: any change of the product shuffles what happens in each, and the rarest is met in one of four. Once one
has broken the law, it runs no further."""


@dataclass(frozen=True, slots=True)
class Provocation:
    """In which climate a mutant breaks which law."""

    law: str
    kinds: tuple[Kind, ...]
    storm_s: float = 30.0
    copies: bool = False
    workload: Workload = "all"
    first: int = 0
    """The seed that is tried first, since it has found it."""

    def order(self, seed: int, mutant: str | None = None) -> Order:
        asked = Order(seed, kinds=self.kinds, storm_s=self.storm_s, mutant=mutant, copies=self.copies, workload=self.workload)
        return replace(asked, participants=FEW) if self.workload == "logs" else asked


BUSY = (Kind.RESET, Kind.DUPLICATION, Kind.CLOCK_OFFSET)
"""Clients meeting at the same places are enough."""
MOVES = (Kind.JOIN, Kind.DRAIN, Kind.KILL_IN_HANDOVER, Kind.SLOW_DISK)
"""Bounds move while much is written to what moves, slowly, and givers die with an open offer."""
SILENCE = (Kind.PAUSE, Kind.RESET, Kind.CLOCK_OFFSET)
"""Nodes that live are removed, and others take their places. Too many cuts at once, and the voter trusts itself no more."""
CUTS = (Kind.ONE_WAY, *BUSY)
"""Nodes that all others hear are not heard by the voter."""
LIES = (Kind.LIAR, Kind.REPLAY)
LYING_MOVES = (Kind.LIAR, Kind.JOIN, Kind.DRAIN, Kind.RESET)
"""Bounds move while a node lies about what lies between them."""
BACKUPS = (Kind.RESTORED_BACKUP, Kind.RESET)
AWAY = (Kind.PAUSE, Kind.PARTITION, Kind.RESET)
"""Who holds copies is away while others are written over, and is compared when it is back."""
HEIRS = (Kind.PAUSE, Kind.PARTITION, Kind.LOST_NODES)
"""Arcs are adopted of which nobody alone knows what was acknowledged."""

ABSENT_MINDED = (Kind.CUT_CLIENT, Kind.PAUSED_CLIENT, Kind.RESET)
"""Clients are cut off, and wake up in another mode."""
CRACKS = (Kind.PARTITION, Kind.CRASH, Kind.WIPED_DISK, Kind.RESET)
"""Of those who decide a log some cannot be reached, and one is replaced. Who goes by an old roster then finds what others decide to be decided
by no majority, and ends over that."""
FEW = 3
"""Participants of a log that is provoked."""

ABSENCES = (Kind.PARTITION, Kind.CRASH, Kind.DRAIN, Kind.JOIN)
"""Who once had a place is away while deletions there are purged, and comes back when another one owns it."""

FORBIDDEN = (Kind.BLACKLIST, Kind.RESET)
"""Administrators change whom copies may lie on; in the first seed that is tried nobody has a blacklist from the beginning."""

UNEVEN = (Kind.LOSS, Kind.SLOW_NODE, Kind.RESET)
"""Packets of renders take long, and not all as long."""
JOLTS = (Kind.RESET, Kind.CLOCK_OFFSET)
"""Renders go on nearly undisturbed."""
DEATHS = (Kind.KILL_IN_RENDER, Kind.RESET, Kind.SLOW_NODE)
"""Nodes die in the midst of renders, which begin attempts while packets are under way."""

PROVOKED = {
    "acknowledged at one copy": Provocation(laws.COPIED, BUSY, copies=True),
    "blacklist not looked at": Provocation(laws.COPIED_AGAIN, FORBIDDEN, copies=True, first=3),
    "chain from a stale roster": Provocation(laws.SOUND, CRACKS, workload="logs"),
    "checked handover": Provocation(laws.VERIFIED, LYING_MOVES, 45.0),
    "credit of links": Provocation(laws.CREDIT, JOLTS, 20.0, workload="renders"),
    "decided header": Provocation(laws.VERIFIED, LIES, first=5),
    "durable before ack": Provocation(laws.DURABLE, BUSY),
    "durable before release": Provocation(laws.CARRIED, MOVES, first=4),
    "films handed on once": Provocation(laws.SOUND, DEATHS, 20.0, workload="renders"),
    "indirect probe": Provocation(laws.REMOVED_RIGHTLY, CUTS, 45.0, first=13),
    "lent lease ignored at the vote": Provocation(laws.MODES_APART, ABSENT_MINDED, workload="logs", first=7),
    "last copy": Provocation(laws.CARRIED, MOVES, 45.0, first=5),
    "left fence": Provocation(laws.ONE_OWNER, BUSY),
    "no fencing": Provocation(laws.FROZEN, ABSENT_MINDED, workload="logs", first=3),
    "no majority": Provocation(laws.CERTIFIED, CRACKS, workload="logs"),
    "others' claims": Provocation(laws.ONE_OWNER, LYING_MOVES, 45.0),
    "own status only": Provocation(laws.VERIFIED, LIES),
    "owner lease": Provocation(laws.ONE_OWNER, SILENCE, 60.0, first=1),
    "packets count once": Provocation(laws.ENDED, UNEVEN, 20.0, workload="renders", first=1),
    "participants speak at once": Provocation(laws.PROMISES, BACKUPS, workload="logs", first=6),
    "purge asks only holders": Provocation(laws.LINEARIZABLE, ABSENCES, 45.0, copies=True, workload="purges"),
    "rays by epoch": Provocation(laws.SOUND, JOLTS, 20.0, workload="renders"),
    "reader's memory": Provocation(laws.SOUND, LIES, first=1),
    "reader's signature check": Provocation(laws.SOUND, LIES, first=1),
    "record of this place": Provocation(laws.SOUND, LIES, first=1),
    "recovery hears one node": Provocation(laws.READABLE, HEIRS, 45.0, copies=True, first=2),
    "renders let go": Provocation(laws.LET_GO, JOLTS, 20.0, workload="renders"),
    "repair trusts the first answer": Provocation(laws.KEPT, AWAY, 45.0, copies=True, first=1),
    "restored backup": Provocation(laws.RIGHT_TO_ANSWER, BACKUPS),
    "second reading": Provocation(laws.EXACT, UNEVEN, 20.0, workload="renders"),
    "signed expectation": Provocation(laws.LINEARIZABLE, BUSY),
    "settling time": Provocation(laws.SETTLED, MOVES, first=1),
    "tombstones collected by age": Provocation(laws.LINEARIZABLE, HEIRS, 45.0, copies=True, workload="purges"),
    "strays brought home": Provocation(laws.BROUGHT_HOME, SILENCE, 60.0, first=3),
    "sums of all nodes": Provocation(laws.EXACT, JOLTS, 20.0, workload="renders"),
    "version check": Provocation(laws.LINEARIZABLE, BUSY),
    "vote not durable": Provocation(laws.CERTIFIED, CRACKS, workload="logs"),
}


LONG = {"renders": [pytest.mark.long]}
"""Marks of storms by workload."""


def test_every_mutant_is_provoked() -> None:
    assert set(PROVOKED) == set(MUTANTS)


@pytest.mark.parametrize("name", [pytest.param(name, marks=LONG.get(each.workload, ())) for name, each in sorted(PROVOKED.items())])
def test_a_mutant_is_found(name: str) -> None:
    provoked = PROVOKED[name]
    seeds = (provoked.first, *(seed for seed in SEEDS if seed != provoked.first))
    orders = (replace(provoked.order(seed, name), until=provoked.law) for seed in seeds)
    assert any(provoked.law in {found.law for found in run(order).violations} for order in orders)


Climate = tuple[tuple[Kind, ...], float, bool, Workload]


def is_long(climate: Climate) -> bool:
    """Of the quick ones `make test` has those without copies and logs; test_smoke.py and test_logs.py see that the product holds in all weather."""
    _, storm_s, copies, workload = climate
    return workload in ("logs", "renders") or copies or storm_s > 30.0


CLIMATES: list[Climate] = list(dict.fromkeys((each.kinds, each.storm_s, each.copies, each.workload) for each in PROVOKED.values()))


def name_of(climate: Climate) -> str:
    kinds, storm_s, copies, workload = climate
    return f"{', '.join(kind.value for kind in kinds)} for {storm_s:g} s{' with copies' if copies else ''}, {workload}"


@pytest.mark.parametrize(
    "climate", [pytest.param(each, id=name_of(each), marks=pytest.mark.long if is_long(each) else ()) for each in CLIMATES]
)
def test_without_a_mutant_the_same_climate_breaks_nothing(climate: Climate) -> None:
    kinds, storm_s, copies, workload = climate
    fail_with_stories([run(Provocation("", kinds, storm_s, copies, workload).order(SEEDS[0]))])
