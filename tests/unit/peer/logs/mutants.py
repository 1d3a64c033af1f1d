"""The shell, or the machine in it, with a hole: each way to be wrong that a storm must find."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from scenefold.consensus import Decide, Event, Participants, Persist, Send, Slot, State, Step, View
from scenefold.consensus.case import Case
from scenefold.consensus.effects import Write
from scenefold.peer.logs.courier import Courier
from scenefold.peer.logs.log import Log
from scenefold.peer.logs.memory import Memory

Mutant = Callable[[pytest.MonkeyPatch], None]


def votes_are_not_durable(patch: pytest.MonkeyPatch) -> None:
    """Promises and votes stay in memory."""
    write = Memory.write

    async def forgetful(self: Memory, what: Write, before: State, after: State) -> None:
        if isinstance(what, Decide):
            await write(self, what, before, after)

    patch.setattr(Memory, "write", forgetful)


def only_promises_are_not_durable(patch: pytest.MonkeyPatch) -> None:
    write = Memory.write

    async def forgetful(self: Memory, what: Write, before: State, after: State) -> None:
        if isinstance(what, Persist):
            what = Persist(replace(what.slot, promised=what.slot.accepted_ballot))
        await write(self, what, before, after)

    patch.setattr(Memory, "write", forgetful)


def the_first_ballot_is_not_durable(patch: pytest.MonkeyPatch) -> None:
    """After a start its node goes without promises again, for something else."""
    write = Memory.write

    async def forgetful(self: Memory, what: Write, before: State, after: State) -> None:
        if isinstance(what, Persist) and what.slot.promised.counter == 0:
            what = Persist(Slot())
        await write(self, what, before, after)

    patch.setattr(Memory, "write", forgetful)


def shown_before_it_is_written(patch: pytest.MonkeyPatch) -> None:
    """What a step sends leaves before its write has begun."""
    couriers: dict[Log, Courier] = {}
    happen: Any = Log._happen
    stepping: Any = Log._step

    async def remember(self: Log, courier: Courier, event: Event) -> None:
        couriers[self] = courier
        await happen(self, courier, event)

    async def early(self: Log, event: Event, view: View) -> Step[State]:
        step: Step[State] = await stepping(self, event, view)
        for effect in step.effects:
            if isinstance(effect, Send):
                couriers[self].send(effect.target, effect.message)
        return step

    patch.setattr(Log, "_happen", remember)
    patch.setattr(Log, "_step", early)


def half_is_a_majority(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Participants, "majority", property(lambda known: max(1, len(known.everyone) // 2)))


def who_seems_alive_decides(patch: pytest.MonkeyPatch) -> None:
    """The roster in place of the record: a majority of whom this node can see now."""
    recorded: Any = Case.__dict__["participants"].fget

    def seen(case: Case) -> Participants:
        everyone = recorded(case).everyone
        there = tuple(one for one in everyone if one.member.node in case.view.alive or one.member == case.setting.me)
        return Participants(there or everyone)

    patch.setattr(Case, "participants", property(seen))


def the_roster_is_stale(patch: pytest.MonkeyPatch) -> None:
    """Who decides is whoever could be reached when the last position was decided, as long as that one lasts."""
    recorded: Any = Case.__dict__["participants"].fget
    rosters: dict[tuple[bytes, int], Participants] = {}

    def remembered(case: Case) -> Participants:
        key = case.setting.me.incarnation, case.state.position
        if key not in rosters:
            everyone = recorded(case).everyone
            there = tuple(one for one in everyone if one.member.node in case.view.reachable or one.member == case.setting.me)
            rosters[key] = Participants(there or everyone)
        return rosters[key]

    patch.setattr(Case, "participants", property(remembered))


MUTANTS: dict[Mutant, int] = {
    votes_are_not_durable: 40,
    only_promises_are_not_durable: 40,
    the_first_ballot_is_not_durable: 40,
    shown_before_it_is_written: 40,
    half_is_a_majority: 40,
    who_seems_alive_decides: 40,
    the_roster_is_stale: 40,
}
"""Within how many seeds each must be found."""
