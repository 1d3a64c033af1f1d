"""If this fails, a restored backup passes for the node itself, or a node that was never restored is taken for one."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field

import pytest
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, precondition, rule

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.reasons import RejectReason
from scenefold.peer.cluster_log.lives import (
    LIFE_BYTES,
    Lives,
    drawn_from,
    is_restored,
    lives_asked_with,
    pack_granted,
    unpack_granted,
    unpack_lives,
)


def test_lives_are_kept_as_they_were() -> None:
    lives = Lives(0, 2**64 - 1)
    assert unpack_lives(lives.pack()) == lives and lives.after(7) == Lives(2**64 - 1, 7)
    for data in (b"", lives.pack()[1:], lives.pack() + b"?"):
        with pytest.raises(DamagedData):
            unpack_lives(data)
    assert unpack_granted(pack_granted(b"i" * 16, 9)) == (b"i" * 16, 9)
    with pytest.raises(DamagedData):
        unpack_granted(b"i" * 16)
    assert drawn_from(bytes(LIFE_BYTES)) == 1 and drawn_from(b"\0" * 7 + b"\5") == 5


def test_who_asks_without_a_life_is_refused() -> None:
    assert lives_asked_with((0, 1)) == Lives(0, 1)
    for values in ((), (1,), (1, 0), (0, 0), (1, 2, 3)):
        with pytest.raises(Refused) as refusal:
            lives_asked_with(values)
        assert refusal.value.reason is RejectReason.ILL_FORMED


@dataclass(eq=False)
class State:
    """What a disk, a backup or a request holds. `is_late`: a life was granted that is not in it."""

    lives: Lives = field(default_factory=Lives)
    is_late: bool = False


@dataclass(eq=False)
class Machine:
    """A disk, and the process on it if one runs. There are several once a copy was started elsewhere."""

    disk: State = field(default_factory=State)
    runs: bool = False
    is_granted: bool = True


@dataclass(eq=False)
class Request:
    """On its way to the voter. `process`: who waits for the answer; None if it crashed, or gave it up."""

    state: State
    process: Machine | None


class Restoring(RuleBasedStateMachine):
    """A node, the voter, backups made at any time and started any number of times, and a network that loses, delays and repeats."""

    def __init__(self) -> None:
        super().__init__()
        self.granted: int | None = None
        self.machines = [Machine()]
        self.backups: list[State] = []
        self.requests: list[Request] = []
        self.drawn = 0
        self.is_honest = True

    def _machine(self, data: st.DataObject) -> Machine:
        return self.machines[data.draw(st.integers(0, len(self.machines) - 1))]

    def _waits_no_more(self, machine: Machine) -> None:
        for request in self.requests:
            request.process = None if request.process is machine else request.process

    @rule(data=st.data())
    def start(self, data: st.DataObject) -> None:
        machine = self._machine(data)
        if not machine.runs:
            machine.runs, machine.is_granted = True, not machine.disk.lives.now

    @rule(data=st.data())
    def crash(self, data: st.DataObject) -> None:
        machine = self._machine(data)
        machine.runs = False
        self._waits_no_more(machine)

    @rule(data=st.data())
    def draw(self, data: st.DataObject) -> None:
        """Durable; whether it is ever asked with is another matter."""
        machine = self._machine(data)
        if machine.runs and machine.is_granted:
            self.drawn += 1
            machine.disk.lives = machine.disk.lives.after(self.drawn)
            machine.is_granted = False

    @rule(data=st.data())
    def ask(self, data: st.DataObject) -> None:
        machine = self._machine(data)
        if machine.runs and machine.disk.lives.now:
            self._waits_no_more(machine)
            self.requests.append(Request(copy(machine.disk), machine))

    @precondition(lambda self: self.requests)
    @rule(data=st.data(), is_answered=st.booleans(), comes_again=st.booleans())
    def judge(self, data: st.DataObject, is_answered: bool, comes_again: bool) -> None:
        """The voter meets a request: the newest, a late one, or one that it has met before."""
        request = self.requests[data.draw(st.integers(0, len(self.requests) - 1))]
        if not comes_again:
            self.requests.remove(request)
        lives = request.state.lives
        if self.granted is not None and is_restored(self.granted, lives):
            assert request.process is None or not self.is_honest, "a node that was never restored is refused"
            return
        assert not request.state.is_late, "who did not know what was granted is granted all the same"
        self.granted = lives.now
        for state in (*(machine.disk for machine in self.machines), *self.backups, *(one.state for one in self.requests)):
            state.is_late |= self.granted not in state.lives
        if is_answered and request.process is not None:
            request.process.is_granted, request.process = True, None

    @rule(data=st.data())
    def back_up(self, data: st.DataObject) -> None:
        self.backups.append(copy(self._machine(data).disk))

    @precondition(lambda self: self.backups)
    @rule(data=st.data(), elsewhere=st.booleans())
    def restore(self, data: st.DataObject, elsewhere: bool) -> None:
        disk = copy(self.backups[data.draw(st.integers(0, len(self.backups) - 1))])
        self.is_honest = False
        if elsewhere:
            self.machines.append(Machine(disk))
        else:
            machine = self._machine(data)
            machine.disk, machine.runs = disk, False
            self._waits_no_more(machine)


TestRestoring = Restoring.TestCase
