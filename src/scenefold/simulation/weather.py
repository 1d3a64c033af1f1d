"""A fault schedule drawn from a seed. Pure: the same seed and settings give the same schedule, in any process.

Each seed leaves out about a third of all kinds (swarm testing: a fault that is always there hides what only shows in its
absence), and some kinds come twice. A schedule is a value, so the shortener may take faults out of it and the rest stays.
"""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import dataclass

from scenefold.simulation.copying import Copying, rack
from scenefold.simulation.faults import CLIENTS, HANDOVER_STEPS, KINDS, TAKEN, VOTER, Fault, Kind, Schedule, Shape, Whom

STORM_S = 42.0
"""Seconds in which faults begin: long enough for a node to be suspected, removed, adopted from, and to come back."""
QUIET_START_S = 4.0
"""The cluster forms and the first records are written before anything goes wrong."""
AGAIN_MAX = 2
LONG_S = 50.0
"""Removal after 20 s of silence, its probes, and the wait for leases take some 40 s together."""
LONG_BEGIN_S = 1.0
"""What lasts so long begins within so many seconds of the quiet start."""
FAULTS_MIN = 8
PRESENT_MAX = 0.7
"""Of all seeds so many at most have a kind. One that takes effect too seldom for that comes more often where it comes."""
SPARES_MAX = 6
RENDER_KILLS = 6
"""In a climate of these."""
MEMBERSHIP = (
    *(kind for kind, shape in KINDS.items() if shape.moves_members),
    Kind.CRASH,
    Kind.CRASH_BEFORE_COMMIT,
    Kind.CRASH_AFTER_COMMIT,
    Kind.WIPED_DISK,
)
"""What makes nodes come, go, and begin anew."""
_COPIES_LATER = {Kind.LYING_HOLDER: "lying holders", Kind.BLACKLIST: "blacklists"}
"""What has dice of its own, so that all else in a seed stayed as it was when it came, and the names of these."""
MEMBERSHIP_MORE, OTHERS_LESS = 1.3, 0.2
"""How much more, or less, often than else, in a climate that is mostly of these."""


@dataclass(frozen=True, slots=True)
class Climate:
    """What a schedule is drawn for: `members` False leaves joins, drains and their interruptions out; `mostly_members` has
    little else than these, and crashes.

    `kinds`: none but these, and each of them; (): any, of which each seed lacks some. `copying`: how copies are kept, if any are.
    """

    nodes: int
    members: bool = True
    mostly_members: bool = False
    storm_s: float = STORM_S
    kinds: tuple[Kind, ...] = ()
    copying: Copying | None = None
    of_clients: bool = False
    """Whether clients are cut off, too, stand still, and have wrong clocks."""
    of_renders: bool = False
    """Whether nodes die over packets of renders, too."""


def draw(seed: int, climate: Climate) -> Schedule:
    """The schedule of a seed."""
    dice = random.Random(f"weather/{seed}/{climate.nodes}/{climate.members}{'/mostly' if climate.mostly_members else ''}")
    allowed = [kind for kind, shape in KINDS.items() if kind in climate.kinds or not climate.kinds]
    allowed = [kind for kind in allowed if not KINDS[kind].of_copies and not KINDS[kind].of_clients and not KINDS[kind].of_renders]
    allowed = [kind for kind in allowed if not KINDS[kind].is_later]
    allowed = [kind for kind in allowed if climate.members or not KINDS[kind].moves_members]
    kinds = [kind for kind in allowed for _ in range(1 if climate.kinds else _times(_odds(kind, climate), dice))]
    if climate.mostly_members and not climate.kinds:
        kinds += [Kind.JOIN, Kind.DRAIN]
        allowed = [kind for kind in allowed if kind in MEMBERSHIP]
    if repeatable := [kind for kind in allowed if KINDS[kind].whom is not Whom.SPARE]:
        kinds += [dice.choice(repeatable) for _ in range(FAULTS_MIN - len(kinds))]
    if repeatable := [kind for kind in kinds if kind in repeatable]:
        kinds += [dice.choice(repeatable) for _ in range(dice.randint(0, AGAIN_MAX))]
    dice.shuffle(kinds)
    spares = iter(range(climate.nodes, climate.nodes + SPARES_MAX))
    faults = [_fault(kind, KINDS[kind], climate, dice, spares) for kind in kinds]
    faults += _later(seed, climate, spares)
    if climate.copying is not None:
        faults += _of_copies(seed, climate, spares)
    if climate.of_clients:
        faults += _of_clients(seed, climate, spares)
    if climate.of_renders:
        faults += _of_renders(seed, climate, spares)
    return tuple(sorted(faults, key=lambda fault: (fault.begin_s, fault.kind.value, fault.slots)))


def spares_of(schedule: Schedule, nodes: int) -> list[int]:
    """The slots that a schedule starts beside the founders."""
    return sorted({slot for fault in schedule for slot in fault.slots if slot >= nodes and not KINDS[fault.kind].of_clients})


def _later(seed: int, climate: Climate, spares: Iterator[int]) -> list[Fault]:
    """What came after all others, with dice of its own."""
    dice = random.Random(f"later weather/{seed}/{climate.nodes}")
    kinds = [kind for kind, shape in KINDS.items() if shape.is_later and (kind in climate.kinds or not climate.kinds)]
    return [_fault(kind, KINDS[kind], climate, dice, spares) for kind in kinds if climate.kinds or _times(_odds(kind, climate), dice)]


def _of_copies(seed: int, climate: Climate, spares: Iterator[int]) -> list[Fault]:
    """What comes on top where copies are kept, with dice of its own: everything else in the seed stays as it is without them."""
    dice = random.Random(f"weather of copies/{seed}/{climate.nodes}")
    allowed = [kind for kind, shape in KINDS.items() if shape.of_copies and (kind in climate.kinds or not climate.kinds)]
    kinds = [kind for kind in allowed if kind not in _COPIES_LATER]
    kinds = [kind for kind in kinds for _ in range(1 if climate.kinds else _times(KINDS[kind].odds, dice))]
    faults = [_fault(kind, KINDS[kind], climate, dice, spares) for kind in kinds]
    for kind, name in _COPIES_LATER.items():
        dice = random.Random(f"weather of {name}/{seed}/{climate.nodes}")
        if kind in allowed and (climate.kinds or _times(KINDS[kind].odds, dice)):
            faults.append(_fault(kind, KINDS[kind], climate, dice, spares))
    return [fault for fault in faults if fault.slots]


def _of_clients(seed: int, climate: Climate, spares: Iterator[int]) -> list[Fault]:
    """What befalls clients, likewise with dice of its own."""
    dice = random.Random(f"weather of clients/{seed}/{climate.nodes}")
    kinds = [kind for kind, shape in KINDS.items() if shape.of_clients and (kind in climate.kinds or not climate.kinds)]
    kinds = [kind for kind in kinds for _ in range(CLIENTS if climate.kinds else _times(KINDS[kind].odds, dice))]
    return [_fault(kind, KINDS[kind], climate, dice, spares) for kind in kinds]


def _of_renders(seed: int, climate: Climate, spares: Iterator[int]) -> list[Fault]:
    """What befalls nodes in the midst of renders, likewise."""
    dice = random.Random(f"weather of renders/{seed}/{climate.nodes}")
    kinds = [kind for kind, shape in KINDS.items() if shape.of_renders and (kind in climate.kinds or not climate.kinds)]
    kinds = [kind for kind in kinds for _ in range(RENDER_KILLS if climate.kinds else _times(KINDS[kind].odds, dice))]
    return [_fault(kind, KINDS[kind], climate, dice, spares) for kind in kinds]


def _odds(kind: Kind, climate: Climate) -> float:
    if not climate.mostly_members:
        return KINDS[kind].odds
    return KINDS[kind].odds * (MEMBERSHIP_MORE if kind in MEMBERSHIP else OTHERS_LESS)


def _times(odds: float, dice: random.Random) -> int:
    if odds <= PRESENT_MAX:
        return int(dice.random() < odds)
    if dice.random() >= PRESENT_MAX:
        return 0
    each = odds / PRESENT_MAX
    return int(each) + (dice.random() < each % 1)


def _fault(kind: Kind, shape: Shape, climate: Climate, dice: random.Random, spares: Iterator[int]) -> Fault:
    begin_s = QUIET_START_S + dice.random() * (climate.storm_s - QUIET_START_S)
    # Short faults are as likely as long ones on a scale of ratios: most real ones are short, and the long ones remove nodes.
    low, high = shape.seconds
    seconds = low * (high / low) ** dice.random() if low else 0.0
    is_long = dice.random() < shape.long_odds
    if is_long:
        # Long enough, and early enough, that the others give a node up and another one takes its place meanwhile.
        begin_s, seconds = QUIET_START_S + dice.random() * LONG_BEGIN_S, dice.uniform(LONG_S, high)
    if kind in (Kind.JOIN, Kind.KILL_IN_JOIN, Kind.DRAIN):
        # What moves the line comes early enough to be in the way of everything else.
        begin_s = QUIET_START_S + (begin_s - QUIET_START_S) * 0.6
    if kind is Kind.KILL_IN_HANDOVER:
        # It lies in wait for a handover from here on; `end_s` only says for how long the node stays down.
        begin_s = QUIET_START_S
    slots, amount = _slots(shape.whom, climate, dice, spares), _amount(shape, dice)
    if kind is Kind.ONE_WAY and is_long:
        # The voter gives nodes up, so a long cut keeps it from hearing one that all others hear.
        slots = next(slot for slot in slots if slot != VOTER), VOTER
    if kind is Kind.KILL_IN_HANDOVER and is_long:
        # The giver is dead for long, and has told nobody that the piece is another's now.
        amount = HANDOVER_STEPS + TAKEN
    return Fault(kind, round(begin_s, 3), round(begin_s + seconds, 3), slots, amount)


def _amount(shape: Shape, dice: random.Random) -> float:
    low, high = shape.amount
    if low < 1:
        return round(dice.uniform(low, high), 4)
    return float(dice.randint(int(low), int(high)))


def _slots(whom: Whom, climate: Climate, dice: random.Random, spares: Iterator[int]) -> tuple[int, ...]:
    nodes, copying = climate.nodes, climate.copying
    if copying is not None and whom is Whom.COPIES:
        size = dice.randint(1, min(copying.copies - 1, nodes - 1))
        return tuple(sorted(dice.sample(range(1, nodes), size)))
    if copying is not None and whom is Whom.RACK:
        # Without racks nobody is hit.
        return rack(dice.randrange(1, copying.racks), copying.racks, nodes) if copying.racks else ()
    if whom is Whom.SEVERAL:
        return tuple(sorted(dice.sample(range(nodes), dice.randint(2, nodes))))
    if whom is Whom.ALL:
        return ()
    if whom is Whom.SPARE:
        return (next(spares),)
    if whom is Whom.CLIENT:
        return (dice.randrange(CLIENTS),)
    if whom is Whom.GROUP:
        size = dice.randint(1, max(1, (nodes - 1) // 2))
        return tuple(sorted(dice.sample(range(nodes), size)))
    if whom is Whom.PAIR:
        pair = [0, dice.randrange(1, nodes)] if dice.random() < 0.5 else dice.sample(range(nodes), 2)
        dice.shuffle(pair)
        return tuple(pair)
    return (dice.randrange(1 if whom is Whom.NO_VOTER else 0, nodes),)
