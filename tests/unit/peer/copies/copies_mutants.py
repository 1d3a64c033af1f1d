"""Rules of specs/20-copies.md left out one by one, to see that the model misses them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from unittest.mock import patch

from scenefold.peer.copies.custody import Custody
from scenefold.peer.copies.segment import Segment
from scenefold.wire import Configuration, Member
from unit.peer.copies.copies_nodes import Rules


def _closed_when_another_is_active(segment: Segment, configuration: Configuration, me: Member) -> bool:
    return configuration is not segment.newest


def _settled_by_number_alone(segment: Segment, have: set[Member], needed: int, me: Member) -> bool:
    return len(have & {me, *segment.holders(me)}) >= needed


PATCHES = {
    "rule 2": (Segment, "is_settled", _settled_by_number_alone),
    "closed": (Segment, "is_closed", _closed_when_another_is_active),
    "not whole": (Custody, "answers", Custody.at),
}
RULES = {
    "debts": Rules(debts=False),
    "compared": Rules(compared=False),
    "floors": Rules(floors=False),
    "incarnations": Rules(incarnations=False),
    "promises": Rules(promises=False),
    "leases of who was not heard": Rules(leases_of_unheard=False),
    "settled when given": Rules(settled_when_given=False),
}
MUTANTS = [*PATCHES, *RULES]


@contextmanager
def without(mutant: str | None) -> Iterator[Rules]:
    """The rules by which the model goes; patched as long as this lasts."""
    if mutant in PATCHES:
        where, name, instead = PATCHES[mutant]
        with patch.object(where, name, instead):
            yield Rules()
    else:
        yield Rules() if mutant is None else RULES[mutant]
