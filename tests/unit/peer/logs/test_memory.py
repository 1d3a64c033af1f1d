"""If this fails, a node speaks under a key that is not known as its own, or keeps what newer positions hold, too."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import trio

from scenefold.consensus import Decide, Participant, Participants, Setting, Slot, State, Value
from scenefold.peer.logs import Owner
from scenefold.peer.logs.memory import Memory
from scenefold.store.log_rows import Decided, StoredLog, Votes
from scenefold.store.logs import Beside
from unit.consensus.logs_made import GENESIS, Book, Key, key_of, member, participants
from unit.store.log_samples import decided

ME = member(1, 7)


class Kept:
    """A store that has decided positions 1 to `newest`, as far as it is asked."""

    def __init__(self, newest: int) -> None:
        self.identity = SimpleNamespace(incarnation=ME.incarnation)
        self.newest = newest
        self.put: list[Decided] = []

    async def read_log(self, genesis: bytes, above: int) -> StoredLog:
        await trio.lowlevel.checkpoint()
        return StoredLog(tuple(decided(position) for position in range(above + 1, self.newest + 1)), Slot())

    async def decided(self, genesis: bytes, above: int, count_max: int, bytes_max: int) -> list[Decided]:
        await trio.lowlevel.checkpoint()
        return [decided(above + 1)] if above < self.newest else []

    async def put_decided(self, genesis: bytes, rows: tuple[Decided, ...], votes: Votes, beside: Beside) -> None:
        await trio.lowlevel.checkpoint()
        self.put += rows


class Lean(Owner):
    def leaner(self, value: Value) -> Value:
        return Value(value.data)


async def test_what_was_decided_before_the_start_is_kept_leaner_once_it_is_not_the_newest() -> None:
    store = Kept(4)
    memory = Memory(cast(Any, store), Setting(GENESIS, ME, key_of(ME)), Lean())
    judge = cast(Any, SimpleNamespace(participants=participants(1, 2, 3)))
    state = await memory.read(judge, 4)
    assert state.position == 4
    next_one = decided(5)
    await memory.write(Decide(5, next_one.value, next_one.certificate), state, State(judge, 5))
    assert [row.position for row in store.put] == [4, 5]
    assert decided(4).value.body and not store.put[0].value.body


def test_a_node_with_another_key_than_is_known_takes_part_in_nothing() -> None:
    memory = Memory(cast(Any, Kept(0)), Setting(GENESIS, ME, key_of(ME)), Owner())
    others = participants(2, 3).everyone
    as_known = Participants((*others, Participant(ME, key_of(ME))))
    otherwise = Participants((*others, Participant(ME, Key(b"another"))))
    for everyone, speaks in ((as_known, True), (otherwise, False), (as_known, True), (participants(2, 3), True)):
        setting = memory.setting(State(Book(everyone)))
        assert (setting.me == ME) is speaks
        assert setting.me in everyone or not speaks or ME not in everyone
