"""If this fails, the judge of histories lets wrong ones pass, or blames right ones."""

from __future__ import annotations

import itertools
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.simulation.history import NEVER_ENDED, Event, Listing, Loss, Outcome, Purge, Read, Return, Version, Write
from scenefold.simulation.linearizable import judge


def version(number: int) -> Version:
    digest = bytes([number]) * 32
    return Version((1, number, 7, 7, digest), digest)


def write(begin: int, end: int, number: int, *, expect: int | str | None = None, outcome: Outcome = Outcome.DONE) -> Write:
    wanted = b"" if expect == "absent" else None if expect is None else version(int(expect)).digest
    return Write(begin, NEVER_ENDED if outcome is Outcome.MAYBE else end, version(number), wanted, outcome)


def read(begin: int, end: int, number: int | None) -> Read:
    return Read(begin, end, None if number is None else version(number).digest)


def refused(begin: int, end: int, number: int, expect: int | str | None = None) -> Write:
    return write(begin, end, number, expect=expect, outcome=Outcome.REFUSED)


def maybe(begin: int, number: int, expect: int | str | None = None) -> Write:
    return write(begin, 0, number, expect=expect, outcome=Outcome.MAYBE)


def purge(begin: int, end: int, number: int) -> Purge:
    return Purge(begin, end or NEVER_ENDED, version(number), is_done=end > 0)


GOOD: dict[str, list[Event]] = {
    "purged": [write(1, 2, 1), purge(3, 4, 1), read(5, 6, None), write(7, 8, 2, expect="absent"), read(9, 10, 2)],
    "purged, or not": [write(1, 2, 1), purge(3, 0, 1), read(5, 6, 1), read(7, 8, None)],
    "purged twice": [write(1, 2, 1), purge(3, 4, 1), purge(5, 6, 1), read(7, 8, None)],
    "nothing": [],
    "what was written is read": [write(1, 2, 1), read(3, 4, 1)],
    "nothing before the first": [read(1, 2, None), write(3, 4, 1)],
    "a read beside a write may see either": [write(1, 10, 1), read(2, 3, None), read(4, 5, 1)],
    "an open write may have happened": [maybe(1, 1), read(2, 3, 1)],
    "an open write may never happen": [maybe(1, 1), read(2, 3, None), read(90, 91, None)],
    "an open write may happen late": [maybe(1, 1), read(2, 3, None), read(4, 5, 1)],
    "one of two that want it empty": [write(1, 4, 1, expect="absent"), refused(2, 5, 2, "absent"), read(6, 7, 1)],
    "a chain of expectations": [write(1, 2, 1), write(3, 4, 2, expect=1), write(5, 6, 3, expect=2), refused(7, 8, 4, 1)],
    "a lower version is refused": [write(1, 2, 5), refused(3, 4, 4), read(5, 6, 5)],
    "an open write that expects what comes later": [maybe(1, 2, expect=1), write(3, 4, 1), read(5, 6, 2)],
    "the same bytes twice": [maybe(1, 1), write(2, 3, 1), read(4, 5, 1)],
    "refused, because the attempt before had happened": [maybe(1, 1, "absent"), refused(2, 3, 2, "absent"), read(4, 5, 1)],
    "lost": [write(1, 2, 1), Loss(3, ()), read(4, 5, None)],
    "lost, as high as the newest": [write(1, 2, 1), Loss(3, (), newest=version(1)), read(4, 5, None)],
    "lost, but not yet": [write(1, 2, 1), Loss(3, ()), read(4, 5, 1), read(6, 7, None)],
    "lost, and an older one is left": [write(1, 2, 1), write(3, 4, 2), Loss(5, (version(1),)), read(6, 7, 1)],
    "lost, and given back": [write(1, 2, 1), Loss(3, (version(1),)), read(4, 5, None), read(6, 7, 1)],
    "lost, written anew, and a higher one given back": [
        write(1, 2, 5),
        Loss(3, (version(5),)),
        write(4, 5, 1, expect="absent"),
        read(6, 7, 1),
        read(8, 9, 5),
    ],
    "lost, and brought back by a backup": [write(1, 2, 1), Loss(3, ()), read(4, 5, None), Return(6, version(1)), read(7, 8, 1)],
    "a backup of what was replaced brings nothing": [write(1, 2, 1), write(3, 4, 2), Return(5, version(1)), read(6, 7, 2)],
    "listed once it is there": [Listing(1, 2, False), write(3, 4, 1), Listing(5, 6, True)],
}

BAD: dict[str, list[Event]] = {
    "purged, and an older one comes back": [write(1, 2, 1), write(3, 4, 2), purge(5, 6, 2), Return(7, version(1)), read(8, 9, 1)],
    "purged, and a late write of before takes effect": [maybe(1, 1), write(2, 3, 2), purge(4, 5, 2), read(6, 7, 1)],
    "purged, and lost by nobody": [write(1, 2, 1), write(3, 4, 2), purge(5, 6, 2), Loss(7, (version(1),)), read(8, 9, 1)],
    "purged, and still there": [write(1, 2, 1), purge(3, 4, 1), read(5, 6, 1)],
    "another one than is there is purged": [write(1, 2, 1), write(3, 4, 2), purge(5, 6, 1), read(7, 8, 2)],
    "a lost write": [write(1, 2, 1), read(3, 4, None)],
    "an old value": [write(1, 2, 1), write(3, 4, 2), read(5, 6, 1)],
    "a value that nobody wrote": [write(1, 2, 1), read(3, 4, 9)],
    "a value before it was written": [read(1, 2, 1), write(3, 4, 1)],
    "back and forth": [write(1, 2, 1), maybe(3, 2), read(4, 5, 2), read(6, 7, 1)],
    "two that wanted it empty": [write(1, 4, 1, expect="absent"), write(2, 5, 2, expect="absent")],
    "a version below is accepted": [write(1, 2, 5), write(3, 4, 4)],
    "two that replace the same": [write(1, 2, 1), write(3, 8, 2, expect=1), write(4, 9, 3, expect=1)],
    "refused for no reason": [write(1, 2, 1), refused(3, 4, 2)],
    "refused though what it expects is there": [write(1, 2, 1), refused(3, 4, 2, 1)],
    "lost before the loss": [write(1, 2, 1), read(3, 4, None), Loss(5, ())],
    "lost, though written after the loss": [write(1, 2, 1), Loss(3, (), newest=version(1)), write(4, 5, 2), read(6, 7, None)],
    "fallen back, though written after the loss": [
        write(1, 2, 1),
        Loss(3, (version(1),), newest=version(1)),
        write(4, 5, 2),
        read(6, 7, 1),
    ],
    "lost twice with one loss": [write(1, 2, 1), Loss(3, ()), read(4, 5, None), write(6, 7, 2), read(8, 9, None)],
    "given back what no disk held": [write(1, 2, 1), Loss(3, ()), read(4, 5, None), read(6, 7, 1)],
    "a backup brings back what was replaced": [write(1, 2, 1), write(3, 4, 2), Return(5, version(1)), read(6, 7, 1)],
    "back before the backup": [write(1, 2, 1), Loss(3, ()), read(4, 5, None), read(6, 7, 1), Return(8, version(1))],
    "an open write happens twice": [maybe(1, 1), Loss(2, ()), read(3, 4, 1), read(5, 6, None), read(7, 8, 1)],
    "not listed though it is there": [write(1, 2, 1), Listing(3, 4, False)],
    "listed before it is there": [Listing(1, 2, True), write(3, 4, 1)],
    "refused writes have effects": [write(1, 2, 5), refused(3, 4, 4), read(5, 6, 4)],
}


@pytest.mark.parametrize("name", GOOD)
def test_good(name: str) -> None:
    assert judge(GOOD[name]).holds


@pytest.mark.parametrize("name", BAD)
def test_bad(name: str) -> None:
    verdict = judge(BAD[name])
    assert not verdict.holds
    assert not verdict.undecided
    assert verdict.stuck is not None


def test_what_cannot_be_explained_is_named() -> None:
    wrong = read(5, 6, 1)
    assert judge([write(1, 2, 1), write(3, 4, 2), wrong, read(7, 8, 2)]).stuck == wrong


def made(seed: int, count: int) -> list[Event]:
    """A history that is right, because it was made from an order: each operation takes effect at a point inside its interval."""
    dice = random.Random(seed)
    state: int | None = None
    events: list[Event] = []
    for index in range(count):
        at = 10 * (index + 1)
        begin, end = at - dice.randint(1, 25), at + dice.randint(1, 25)
        act = dice.choice(["write", "write", "absent", "replace", "read", "maybe", "never", "list"])
        number = dice.randint(1, 200)
        if act == "read":
            events.append(read(begin, end, state))
        elif act == "list":
            events.append(Listing(begin, end, state is not None))
        elif act == "never":
            events.append(maybe(begin, number))
        else:
            expect: int | str | None = {"absent": "absent", "replace": dice.choice([state, 201]) or "absent"}.get(act)
            matches = expect is None or expect == ("absent" if state is None else state)
            fits = number == state or (matches and (state is None or number > state))
            if act == "maybe":
                events.append(maybe(begin, number, expect))
            else:
                events.append(write(begin, end, number, expect=expect, outcome=Outcome.DONE if fits else Outcome.REFUSED))
            state = number if fits else state
    return events


@given(st.integers(0, 10**9), st.integers(0, 40))
def test_whatever_was_made_from_an_order_holds(seed: int, count: int) -> None:
    assert judge(made(seed, count)).holds


@given(st.integers(0, 10**9), st.integers(1, 6))
def test_it_agrees_with_trying_every_order(seed: int, count: int) -> None:
    events = made(seed, count)
    dice = random.Random(seed)
    index = dice.randrange(len(events))
    if isinstance(events[index], Read):
        events[index] = read(events[index].begin, events[index].end, dice.choice([None, 1, 50, 200]))  # type: ignore[union-attr]
    assert judge(events).holds == any(_explains(order) for order in _orders(events))


def _orders(events: list[Event]) -> list[tuple[Event, ...]]:
    must = [event for event in events if not (isinstance(event, Write) and event.outcome is Outcome.MAYBE)]
    may = [event for event in events if isinstance(event, Write) and event.outcome is Outcome.MAYBE]
    chosen = [must + list(some) for size in range(len(may) + 1) for some in itertools.combinations(may, size)]
    return [order for events in chosen for order in itertools.permutations(events) if _respects_time(order)]


def _respects_time(order: tuple[Event, ...]) -> bool:
    ends = [getattr(event, "end", NEVER_ENDED) for event in order]
    return all(ends[later] >= order[sooner].begin for sooner in range(len(order)) for later in range(sooner + 1, len(order)))


def _explains(order: tuple[Event, ...]) -> bool:
    state: Version | None = None
    for event in order:
        if isinstance(event, Read):
            if event.digest != (state.digest if state else None):
                return False
        elif isinstance(event, Listing):
            if event.present != (state is not None):
                return False
        elif isinstance(event, Write):
            there = state is not None and state.digest == event.version.digest
            fits = there or (
                event.expect in (None, state.digest if state else b"") and (state is None or event.version.order > state.order)
            )
            if fits == (event.outcome is Outcome.REFUSED):
                return False
            state = event.version if fits else state
    return True


def test_long_histories_of_busy_places_are_decided() -> None:
    dice = random.Random(3)
    for seed in range(20):
        verdict = judge(made(dice.randrange(10**9) + seed, 250))
        assert verdict.holds
