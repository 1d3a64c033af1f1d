"""What happened in a run, in the order of virtual time, for a person who looks for the reason (specs/17-simulation.md, Runs).

Everything that observers see becomes a line, cheaply: words are put together only when a story is told. A story has the
schedule, then what concerns the place or the nodes of the violation, the last lines before it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from scenefold.simulation.faults import Schedule

LINES_MAX = 60_000
TOLD_MAX = 120
AFTERWARDS_S = 1.0


@dataclass(frozen=True, slots=True)
class Violation:
    """What did not hold. `law` names the checker; `location` and `slots` say whose story is to be told."""

    law: str
    what: str
    at_s: float
    location: bytes | None = None
    slots: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Line:
    """Something that happened. `slot` None: to nobody in particular; `location` None: to no record in particular."""

    at_s: float
    slot: int | None
    location: bytes | None
    what: str
    values: tuple[object, ...] = ()

    def __str__(self) -> str:
        who = "" if self.slot is None else f"n{self.slot}"
        return f"{self.at_s:9.3f} s  {who:<4} {self.what.format(*self.values)}"


class Story:
    """Collects lines; the oldest are forgotten first."""

    def __init__(self) -> None:
        self.lines: deque[Line] = deque(maxlen=LINES_MAX)

    def tell(self, at_s: float, slot: int | None, what: str, *values: object, location: bytes | None = None) -> None:
        """`what` may have places in braces for the values."""
        self.lines.append(Line(at_s, slot, location, what, values))

    def about(self, violation: Violation) -> list[str]:
        """What led to a violation, and the second behind it."""
        concerned = [line for line in self.lines if line.at_s <= violation.at_s + AFTERWARDS_S and _concerns(line, violation)]
        left_out = max(0, len(concerned) - TOLD_MAX)
        head = [f"… {left_out} earlier lines"] if left_out else []
        return head + [str(line) for line in concerned[left_out:]]


def _concerns(line: Line, violation: Violation) -> bool:
    if line.location is not None:
        return line.location == violation.location
    return line.slot is None or not violation.slots or line.slot in violation.slots


def told(seed: int, schedule: Schedule, numbers: Sequence[int], violations: Sequence[Violation], lines: Iterable[str], replay: str) -> str:
    """The whole story as text. `numbers`: of the faults, in the whole schedule of the seed."""
    parts = [f"seed {seed}: {len(violations)} violation{'s' if len(violations) != 1 else ''}", ""]
    parts += [f"  {violation.at_s:9.3f} s  {violation.law}: {violation.what}" for violation in violations[:10]]
    parts += [
        "",
        "faults:",
        *(f"  {number:2d}  {fault}" for number, fault in zip(numbers, schedule, strict=True)),
        "",
        "what happened:",
        *(f"  {line}" for line in lines),
    ]
    return "\n".join([*parts, "", f"again: {replay}", ""])
