"""Some nodes that decide one log, with disks, a network and a clock, all from a seed, and all that may go wrong with them.

No Trio and nothing of the rest of the project: an event is taken from a queue and given to the machine, and the effects of the step
are carried out in their order. A node may crash between any two of them. What is on its way is a value that may come late,
twice, or never.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from random import Random

from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.consensus import (
    Ask,
    AskLog,
    Certificate,
    Decide,
    Effect,
    Event,
    Learn,
    Lost,
    Message,
    Persist,
    Propose,
    Received,
    Reply,
    Send,
    SetTimer,
    Setting,
    Slot,
    Started,
    State,
    Tell,
    TimeOver,
    Timer,
    Timing,
    Value,
    View,
    take,
)
from scenefold.wire import Member
from unit.consensus.laws import Laws
from unit.consensus.logs_made import GENESIS, NOTHING, Book, Change, Key, key_of, member, participants

DEADLINE_S = 30.0
SYNC_S = 10.0


@dataclass
class Disk:
    member: Member
    slot: Slot = field(default_factory=Slot)
    log: list[tuple[Value, Certificate]] = field(default_factory=list)
    is_full: bool = False


@dataclass
class Node:
    disk: Disk
    state: State | None = None
    """None while it is down."""
    timers: dict[Timer, int] = field(default_factory=dict)
    replies: list[Reply] = field(default_factory=list)
    veto: RejectReason | None = None
    abstains: bool = False

    @property
    def book(self) -> Book:
        assert self.state is not None and isinstance(self.state.judge, Book)
        return self.state.judge


@dataclass
class Weather:
    """What is done to packets: each chance is that of one packet."""

    lost: float = 0.0
    twice: float = 0.0
    replayed: float = 0.0
    delay_s: tuple[float, float] = (0.01, 0.01)


class World:
    def __init__(self, seed: int, *nodes: int, first: Collection[int] = (), weather: Weather | None = None) -> None:
        """`first`: who takes part at position 1, all if nobody is named. The order of the line is that of `nodes`."""
        self.random = Random(seed)
        self.line = tuple(NodeId(node) for node in nodes)
        self.first = Book(participants(*(first or nodes)))
        self.laws = Laws(self.first)
        self.weather = weather or Weather()
        self.now = 0.0
        self.blocked: set[tuple[int, int]] = set()
        self.believed: set[int] = set()
        """Who seems alive to all others even while it is down: that takes others a while to notice."""
        self.timing = Timing()
        self.at_once_bytes = 0
        self.packets: list[tuple[float, int, int, Message]] = []
        """All that were ever sent: when, by whom, to whom."""
        self.crash_in: dict[int, int] = {}
        """After so many more effects a node crashes."""
        self.steps = 0
        self.filter: Callable[[int, int, Message], bool] = lambda source, target, message: True
        """Which packets pass, beside the weather."""
        self.shows_late = False
        """A mutant: what a step shows is shown before it is written."""
        self.forgets: Callable[[Slot], Slot] = lambda slot: slot
        """A mutant: what is left of a slot after a restart."""
        self.opens_early = False
        """A mutant: whoever hears of position c + 2 takes what it has voted for at c + 1 for decided."""
        self._queue: list[tuple[float, int, Callable[[], None]]] = []
        self._counter = 0
        self.nodes = {node: Node(Disk(member(node))) for node in nodes}
        for node in nodes:
            self.start(node)

    # -------------------------------------------------------------------------------------------------------- nodes

    def up(self, node: int) -> bool:
        return self.nodes[node].state is not None

    def start(self, node: int) -> None:
        """A node reads its disk."""
        known, judge = self.nodes[node], self.first
        for value, _ in known.disk.log:
            judge = judge.after(value)
        known.disk.slot = self.forgets(known.disk.slot)
        known.state = State(judge, len(known.disk.log), known.disk.slot)
        self.laws.restarted(known.disk.member, len(known.disk.log) + 1, known.disk.slot)
        self.happen(node, Started())

    def crash(self, node: int) -> None:
        self.nodes[node].state = None
        self.nodes[node].timers.clear()
        self.crash_in.pop(node, None)

    def wipe(self, node: int, *, same_incarnation: bool = False) -> Member:
        """The disk of a node that is down is lost; whoever comes back has another incarnation."""
        assert not self.up(node)
        before = self.nodes[node].disk.member
        self.laws.wiped(before)
        life = int.from_bytes(before.incarnation, "big") + (not same_incarnation)
        self.nodes[node] = Node(Disk(member(node, life)), replies=self.nodes[node].replies)
        return self.nodes[node].disk.member

    # ------------------------------------------------------------------------------------------------------- events

    def happen(self, node: int, event: Event) -> None:
        """One step of one node, and its effects; nothing, if it is down."""
        known = self.nodes[node]
        if known.state is None:
            return
        self.steps += 1
        if self.opens_early:
            self._open_early(known, event)
        setting = Setting(GENESIS, known.disk.member, self.key(known.disk.member), self.timing, self.at_once_bytes)
        step = take(setting, known.state, event, self._view(node, can_write=not known.disk.is_full))
        before, known.state = known.state, step.after
        effects = (*step.effects[1:], *step.effects[:1]) if self.shows_late and step.write else step.effects
        for effect in effects:
            if self._crashes(node):
                return
            self._carry_out(node, before, effect)
        if self.crash_in.get(node) == 0:
            self.crash(node)

    def _open_early(self, known: Node, event: Event) -> None:
        state, message = known.state, event.message if isinstance(event, Received) else None
        if state is None or state.slot.accepted is None or not isinstance(message, Propose | Learn):
            return
        position = message.position if isinstance(message, Learn) else message.proposal.position
        if position == state.position + 2:
            value, judge = state.slot.accepted.value, state.judge.after(state.slot.accepted.value)
            known.disk.log.append((value, Certificate(state.position + 1, state.slot.accepted.ballot, ())))
            known.disk.slot, known.state = Slot(), State(judge, state.position + 1)
            self.laws.decide(state.position + 1, value, known.book)

    def key(self, who: Member) -> Key:
        return key_of(who)

    def _view(self, node: int, *, can_write: bool) -> View:
        there = [other for other in self.line if other != node and (self.up(other) or other in self.believed)]
        reachable = frozenset(other for other in there if (node, other) not in self.blocked)
        alive = frozenset(other for other in there if (other, node) not in self.blocked) | {NodeId(node)}
        known = self.nodes[node]
        return View(self.now, self.line, reachable, alive, can_write, known.veto, known.abstains)

    def _crashes(self, node: int) -> bool:
        left = self.crash_in.get(node)
        if left is None:
            return False
        if left == 0:
            self.crash(node)
            return True
        self.crash_in[node] = left - 1
        return False

    def _carry_out(self, node: int, before: State, effect: Effect) -> None:
        known = self.nodes[node]
        match effect:
            case Persist(slot):
                known.disk.slot = slot
                self.laws.wrote(known.disk.member, before.position + 1, effect, known.book)
            case Decide(_, value, certificate):
                known.disk.log.append((value, certificate))
                known.disk.slot = Slot()
                self.laws.wrote(known.disk.member, before.position + 1, effect, known.book)
            case Send(target, message):
                self.send(node, target, message)
            case Tell(target, above):
                for position, (value, certificate) in enumerate(known.disk.log[above:], above + 1):
                    self.send(node, target, Learn(GENESIS, position, value, certificate))
            case SetTimer(timer, least, most):
                self._counter += 1
                known.timers[timer] = number = self._counter
                self.after(self.random.uniform(least, most), lambda: self._ring(node, timer, number))
            case Reply():
                known.replies.append(effect)
                self.laws.replied(effect)

    def _ring(self, node: int, timer: Timer, number: int) -> None:
        if self.nodes[node].timers.get(timer) == number:
            del self.nodes[node].timers[timer]
            self.happen(node, TimeOver(timer))

    # ------------------------------------------------------------------------------------------------------ network

    def send(self, source: int, target: int, message: Message) -> None:
        self.packets.append((self.now, source, target, message))
        if (source, target) in self.blocked or not self.filter(source, target, message):
            return
        if not self.up(target):
            self.after(0.01, lambda: self.happen(source, Lost(NodeId(target))))
            return
        if self.random.random() >= self.weather.lost:
            self.deliver(source, target, message)
        if self.random.random() < self.weather.twice:
            self.deliver(source, target, message)
        if self.random.random() < self.weather.replayed:
            _, was, to, old = self.random.choice(self.packets)
            self.deliver(was, to, old)

    def deliver(self, source: int, target: int, message: Message) -> None:
        event = Received(NodeId(source), message)
        self.after(self.random.uniform(*self.weather.delay_s), lambda: self.happen(target, event))

    def part(self, *sides: Collection[int]) -> None:
        """Nobody hears another side."""
        self.blocked = {(a, b) for one in sides for other in sides if one is not other for a in one for b in other}

    def heal(self) -> None:
        self.blocked = set()

    # -------------------------------------------------------------------------------------------------------- asking

    def ask(
        self,
        node: int,
        request: str,
        change: Change = NOTHING,
        *,
        within: float = DEADLINE_S,
        is_for_all: bool = False,
        needs_consent: bool = True,
    ) -> Value:
        """Somebody asks a node for something, as things stand there. If it is asked for again, what was said of it is no promise any more."""
        value = self.nodes[node].book.value(request, node, change)
        self.laws.rejected.discard(value.digest)
        self.happen(node, Ask(value, self.now + within, is_for_all, needs_consent=needs_consent))
        return value

    def ask_again(self, node: int, value: Value | None, *, within: float = DEADLINE_S, needs_consent: bool = True) -> None:
        """The very same value once more."""
        if value is not None:
            self.laws.rejected.discard(value.digest)
        self.happen(node, Ask(value, self.now + within, needs_consent=needs_consent))

    def sync(self, node: int, other: int) -> None:
        """T_sync: ask another node for what is lacking."""
        if self.up(node):
            self.send(node, other, AskLog(GENESIS, len(self.nodes[node].disk.log)))

    def keep_in_step(self) -> None:
        """T_SYNC: from now on each node asks another one now and then."""

        def sync(node: int) -> None:
            self.sync(node, self.random.choice([other for other in self.nodes if other != node]))
            self.after(SYNC_S * self.random.uniform(0.8, 1.2), lambda: sync(node))

        for node in self.nodes:
            self.after(self.random.uniform(0, SYNC_S), lambda node=node: sync(node))  # type: ignore[misc]

    # ---------------------------------------------------------------------------------------------------------- time

    def after(self, seconds: float, what: Callable[[], None]) -> None:
        self._counter += 1
        heapq.heappush(self._queue, (self.now + seconds, self._counter, what))

    def run(self, seconds: float = 60.0, until: Callable[[], bool] = lambda: False) -> None:
        """Let time pass, until nothing is going on any more, or something holds."""
        end = self.now + seconds
        while self._queue and self._queue[0][0] <= end and not until():
            self.now, _, what = heapq.heappop(self._queue)
            what()
        if not until():
            self.now = max(self.now, end)

    # ------------------------------------------------------------------------------------------------------- judging

    def log(self, node: int) -> list[str]:
        """The requests that are decided, as a node knows it."""
        judge = self.first
        for value, _ in self.nodes[node].disk.log:
            judge = judge.after(value)
        return list(judge.requests)

    def agree(self, *nodes: int) -> list[str]:
        """All these nodes have the same log, and nothing tentative; answers it."""
        logs = {tuple(self.log(node)) for node in nodes or self.nodes}
        assert len(logs) == 1, logs
        assert all(self.nodes[node].disk.slot.accepted is None for node in nodes or self.nodes)
        return list(logs.pop())
