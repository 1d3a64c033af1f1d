"""Transitions as data: the first row that fits is taken (specs/25-consensus.md, The acceptor and The proposer).

The tables of the specification and the drawing in the documentation are made from these rows, and a guard or an action is called
in the rows what its function is called.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TypeVar

from scenefold.base.reasons import RejectReason
from scenefold.consensus.state import Stage

Subject = TypeVar("Subject")
Guards = Mapping[str, Callable[[Subject], bool]]
Actions = Mapping[str, Callable[[Subject], None]]


@dataclass(frozen=True, slots=True)
class Row:
    """On one of these events, in one of these stages, if all guards hold: do this, and then be there."""

    on: tuple[str, ...]
    given: tuple[str, ...] = ()
    do: tuple[str, ...] = ()
    reason: RejectReason | None = None
    """What a refusal or a reply among the actions says."""
    at: tuple[Stage, ...] = ()
    """Any, if none is named."""
    then: Stage | None = None
    """The same as before, if none is named."""


def first_fit(rows: Iterable[Row], event: str, stage: Stage | None, guards: Guards[Subject], subject: Subject) -> Row | None:
    """The row to be taken; None: what happens is none of this table's business."""
    for row in rows:
        if event in row.on and (not row.at or stage in row.at) and all(guards[name](subject) for name in row.given):
            return row
    return None


def named(functions: Iterable[Callable[[Subject], bool]]) -> dict[str, Callable[[Subject], bool]]:
    """Guards by their names."""
    return {function.__name__: function for function in functions}


def acting(functions: Iterable[Callable[[Subject], None]]) -> dict[str, Callable[[Subject], None]]:
    """Actions by their names."""
    return {function.__name__: function for function in functions}
