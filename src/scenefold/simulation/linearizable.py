"""Is there an order in which one location's operations make sense? (Wing and Gong, with Lowe's memory of dead ends.) Pure.

Locations are independent, so each history is judged alone (Horn and Kroening's partition). The specification is that of
the store: a write takes effect if what it expects is there and its version is above what is there; a read gives what is
there. What has no known outcome may take effect at any later time, or never. A loss (history.py) may take effect likewise.
A purged deletion reads as nothing, and nothing older takes its place: that is a version without a digest.

The search linearizes one operation after another, always one that began before the earliest end of those that are left,
and never comes to the same (operations that are done, state) twice unless with fewer of the optional ones used up.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from scenefold.simulation.history import Event, Listing, Loss, Outcome, Purge, Read, Return, Version, Write

STEPS_MAX = 400_000
State = Version | None


@dataclass(frozen=True, slots=True)
class Verdict:
    """`stuck`: the first operation that no order can explain, for the story. `undecided`: the search was given up."""

    holds: bool
    undecided: bool = False
    stuck: Event | None = None
    state: State = None
    """What was there, as far as the search came, when `stuck` made no sense."""


_Step = Write | Read | Listing | Loss | Return | Purge
_Must = Write | Read | Listing | Purge
_NOTHING = b""


def judge(history: Sequence[Event], steps_max: int = STEPS_MAX) -> Verdict:
    """Whether the history of one location is linearizable."""
    must, may = _sorted(history)
    versions = {event.version.digest: event.version for event in history if isinstance(event, Write)}
    for event in must:
        if isinstance(event, Read) and event.digest is not None and event.digest not in versions:
            return Verdict(False, stuck=event)
    return _search(must, may, steps_max)


def _sorted(history: Sequence[Event]) -> tuple[list[_Must], list[_Step]]:
    """What must take its place in the order, by beginning; and what may."""
    must: list[_Must] = []
    may: list[_Step] = []
    for event in history:
        if isinstance(event, Loss):
            may.append(event)
            may += [Return(event.begin, version) for version in event.left]
        elif isinstance(event, Return) or _is_open(event):
            may.append(event)
        else:
            must.append(event)
    return sorted(must, key=lambda event: (event.begin, event.end)), sorted(may, key=lambda event: event.begin)


def _is_open(event: _Must) -> bool:
    """Whether it may have happened, or not."""
    return (isinstance(event, Write) and event.outcome is Outcome.MAYBE) or (isinstance(event, Purge) and not event.is_done)


def _search(must: list[_Must], may: list[_Step], steps_max: int) -> Verdict:
    everything = (1 << len(must)) - 1
    seen: dict[tuple[int, State], list[int]] = {}
    stack: list[tuple[int, State, int]] = [(0, None, 0)]
    farthest = -1
    where: tuple[int, State] = (0, None)
    steps = 0
    while stack:
        done, state, used = stack.pop()
        if done == everything:
            return Verdict(True)
        if not _is_news(seen, done, state, used):
            continue
        steps += 1
        if steps > steps_max:
            return Verdict(False, undecided=True)
        if done.bit_count() > farthest:
            farthest, where = done.bit_count(), (done, state)
        window = _window(must, done)
        limit = min(must[index].end for index in window)
        # Pushed first, tried last: optional operations are used only where nothing else leads on.
        for index, option in enumerate(may):
            if option.begin < limit and not used >> index & 1:
                stack += [(done, following, used | 1 << index) for following in _effects(option, state)]
        for index in reversed(window):
            if must[index].begin < limit:
                stack += [(done | 1 << index, following, used) for following in _effects(must[index], state)]
    done, state = where
    stuck = min((must[index] for index in _window(must, done)), key=lambda event: event.end)
    return Verdict(False, stuck=stuck, state=state)


def _window(must: list[_Must], done: int) -> list[int]:
    """What is left and could come next: all that began before the earliest end of what is left."""
    found: list[int] = []
    limit = 1 << 63
    for index, event in enumerate(must):
        if event.begin > limit:
            break
        if not done >> index & 1:
            found.append(index)
            limit = min(limit, event.end)
    return found


def _is_news(seen: dict[tuple[int, State], list[int]], done: int, state: State, used: int) -> bool:
    """False if we were here before with no more of the optional operations used up."""
    before = seen.setdefault((done, state), [])
    if any(other & used == other for other in before):
        return False
    before[:] = [other for other in before if used & other != used]
    before.append(used)
    return True


def _effects(step: _Step, state: State) -> Iterator[State]:
    """The states after a step, none if it cannot be next."""
    match step:
        case Read():
            if (step.digest or _NOTHING) == _digest(state):
                yield state
        case Listing():
            if step.present == (_digest(state) != _NOTHING):
                yield state
        case Purge():
            yield from _purged(step, state)
        case Return():
            if state is None or step.version.order > state.order:
                yield step.version
        case Loss():
            yield from _lost(step, state)
        case Write():
            yield from _written(step, state)


def _lost(loss: Loss, state: State) -> Iterator[State]:
    if state is not None and (state.digest == _NOTHING or (loss.newest is not None and state.order > loss.newest.order)):
        # What is purged is nowhere any more: nobody can lose it.
        return
    if state is not None and loss.or_nothing:
        yield None
    yield from (version for version in loss.left if version != state)


def _purged(purge: Purge, state: State) -> Iterator[State]:
    if _digest(state) == purge.version.digest:
        yield Version(purge.version.order, _NOTHING)
    elif purge.is_done and _digest(state) == _NOTHING:
        yield state


def _digest(state: State) -> bytes:
    return _NOTHING if state is None else state.digest


def _written(write: Write, state: State) -> Iterator[State]:
    is_there = state is not None and state.digest == write.version.digest
    expected = write.expect is None or write.expect == _digest(state)
    fits = is_there or (expected and (state is None or write.version.order > state.order))
    if write.outcome is Outcome.REFUSED:
        if not fits:
            yield state
    elif is_there:
        # The same bytes again: a retry that is answered, or that nobody waits for any more.
        if write.outcome is Outcome.DONE:
            yield state
    elif fits:
        yield write.version
