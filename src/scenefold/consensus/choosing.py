"""Which value a ballot is for, once a majority has promised to take part in no lower one (specs/25-consensus.md, Choosing the value)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from scenefold.consensus.ballots import NO_BALLOT
from scenefold.consensus.facts import Fact, Promise
from scenefold.consensus.participants import Participants
from scenefold.consensus.values import Value


@dataclass(frozen=True, slots=True)
class Choice:
    """`value`: None if none was asked for, and nobody has voted for any."""

    value: Value | None


def named_highest(facts: Iterable[Fact]) -> Promise | None:
    """The promise that names the highest ballot voted in; None if none names any."""
    naming = [fact for fact in facts if isinstance(fact, Promise) and fact.accepted != NO_BALLOT]
    return max(naming, key=lambda promise: promise.accepted, default=None)


def highest_of(facts: Sequence[Fact], values: Iterable[Value]) -> Value | None:
    """Of these values the one of the highest ballot that a promise names: the only one that has to travel on."""
    ballots = {fact.digest: fact.accepted for fact in sorted_promises(facts) if fact.accepted != NO_BALLOT}
    known = [value for value in values if value.digest in ballots]
    return max(known, key=lambda value: ballots[value.digest], default=None)


def choose(facts: Sequence[Fact], values: Iterable[Value], wish: Value | None, participants: Participants) -> Choice | None:
    """The value that these promises leave; None if they are too few. If the bytes of the highest are not there, whoever names it counts
    as not having promised: fewer promises are promises too."""
    known = {value.digest: value for value in values}
    promises = sorted_promises(facts)
    while len(promises) >= participants.majority:
        highest = named_highest(promises)
        if highest is None:
            return Choice(wish)
        if highest.digest in known:
            return Choice(known[highest.digest])
        promises = [promise for promise in promises if promise.accepted != highest.accepted]
    return None


def sorted_promises(facts: Iterable[Fact]) -> list[Promise]:
    """The promises among facts, those of low accepted ballots first."""
    return sorted((fact for fact in facts if isinstance(fact, Promise)), key=lambda promise: promise.accepted)
