"""One log at one node: events one after the other through the machine, and what comes of each (specs/25-consensus.md, On a node).

First what is to be written, then what is to be seen: a step whose write fails has not happened, and the event is tried anew as by a
node that cannot write. Everything else may fail, come late or be forgotten.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import trio

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId
from scenefold.consensus import (
    Ask,
    AskLog,
    Decide,
    Effect,
    Event,
    Judge,
    Learn,
    Lost,
    Message,
    Propose,
    Received,
    Reply,
    Send,
    SetTimer,
    Setting,
    Stage,
    Started,
    State,
    Step,
    Tell,
    TimeOver,
    View,
    take,
)
from scenefold.peer.logs.ahead import Ahead
from scenefold.peer.logs.asking import Answer, Asking, Make
from scenefold.peer.logs.courier import Courier
from scenefold.peer.logs.inbox import Inbox, fits
from scenefold.peer.logs.memory import Memory
from scenefold.peer.logs.ports import Carrier, Owner, Surroundings
from scenefold.peer.logs.timers import Timers
from scenefold.store import Store
from scenefold.wire import Phase
from scenefold.world import World

SYNC_S = 10.0
"""T_SYNC: a random participant is asked for what is lacking, 20 % sooner or later."""
SHUN_S = 1.0
"""So long nobody is sent to a node that could not be reached."""
ASK_AGAIN_S = 0.9
"""So long `catch_up` asks nobody again."""
AT_ONCE_BYTES = 1024 * 1024
"""Of values, for a pass that goes straight to all others: larger ones travel hop by hop, so that no node sends them to all."""
TELL_MAX = 256
TELL_BYTES_MAX = 4 * 1024 * 1024
"""What is told at once of a log that somebody lacks, beside the newest position: that one makes him ask again."""


class Log:
    """Made by `open_log`; `run` it in one task. Others call `receive`, `lost` and `ask`."""

    def __init__(
        self,
        world: World,
        store: Store,
        setting: Setting,
        memory: Memory,
        state: State,
        carrier: Carrier,
        around: Surroundings,
        owner: Owner,
    ) -> None:
        self._world, self._store, self._setting, self._memory = world, store, setting, memory
        self._state, self._carrier, self._around, self._owner = state, carrier, around, owner
        self._inbox, self._ahead = Inbox(), Ahead()
        self._asking = Asking(self._inbox.wake)
        self._timers = Timers(world.clock, world.entropy)
        self._shunned: dict[NodeId, float] = {}
        self._sync_at = world.clock.now()
        self._to_ask: set[NodeId] = set()
        self._asked_at: dict[frozenset[NodeId], float] = {}
        self._is_restated = False
        self.taken_over = 0
        """Proposals of others that this node has begun to bring to an end."""

    # ------------------------------------------------------------------------------------------------- for others

    @property
    def genesis(self) -> bytes:
        return self._setting.genesis

    @property
    def judge(self) -> Judge:
        """All that is decided here, durably."""
        return self._state.judge

    @property
    def position(self) -> int:
        """The newest that is decided here."""
        return self._state.position

    @property
    def is_silent(self) -> bool:
        """What this node has voted for at the open position was damaged, or its owner has it say nothing yet."""
        return self._memory.setting(self._state) != self._setting

    def receive(self, sender: NodeId, message: Message) -> None:
        """A packet of a node. Returns at once; what finds no room, or is larger than anything, is lost."""
        if fits(message):
            self._inbox.put(Received(sender, message))

    def restate(self) -> None:
        """Whether this node speaks has changed: its owner hears once more how the open position stands, and the machine begins as after a
        start, since who was silent then took over nothing of what it has voted for."""
        self._owner.stands(self._state.slot, is_silent=self.is_silent)
        self._is_restated = True
        self._inbox.wake()

    def lost(self, node: NodeId) -> None:
        """A connection to a node is refused, or broken."""
        self._shunned[node] = self._world.clock.now() + SHUN_S
        self._inbox.put(Lost(node))

    def catch_up(self, others: Iterable[NodeId]) -> None:
        """There is more than is known here: these may tell it. They are asked at once, if these were not asked together a moment ago."""
        now, asked = self._world.clock.now(), frozenset(others) - {self._setting.me.node}
        self._asked_at = {known: at for known, at in self._asked_at.items() if now - at < ASK_AGAIN_S}
        if asked not in self._asked_at:
            self._asked_at[asked] = now
            self._to_ask |= asked
            self._inbox.wake()

    async def ask(
        self, make: Make | None, within_s: float, *, is_for_all: bool = False, is_forced: bool = False, needs_consent: bool = True
    ) -> Answer:
        """Have something decided, at whatever position; without `make` look whether anything may have been begun (a barrier).

        `is_for_all`: whoever seems alive is to have agreed; `is_forced`: nobody is asked whether it suits him; `needs_consent` false: no
        participant can have anything against it (specs/26-modes.md), and so it may be decided sooner. Refused if it makes no sense, or
        too many wait already. After UNKNOWN, or if this is cancelled, whoever has asked asks again.
        """
        deadline = self._world.clock.now() + within_s
        return await self._asking.ask(make, deadline, is_for_all=is_for_all, is_forced=is_forced, needs_consent=needs_consent)

    # --------------------------------------------------------------------------------------------------- its task

    async def run(self, *, task_status: trio.TaskStatus[None] = trio.TASK_STATUS_IGNORED) -> None:
        """Until cancelled. An error of the disk ends it, and with that the node."""
        try:
            async with trio.open_nursery() as nursery:
                courier = Courier(nursery, self._carrier, self.lost)
                self._owner.stands(self._state.slot, is_silent=self.is_silent)
                await self._happen(courier, Started())
                task_status.started()
                while True:
                    await trio.lowlevel.checkpoint()
                    self._asking.expire(self._state, self._world.clock.now())
                    event = self._next()
                    if event is not None:
                        await self._happen(courier, event)
                        continue
                    self._ask_others(courier)
                    now = self._world.clock.now()
                    if now >= self._sync_at:
                        self._sync(courier, now)
                    late_s = max(0.0, self._asking.next_late_at() - now)
                    await self._inbox.wait(min(self._timers.wait_s(), self._sync_at - now, late_s))
        finally:
            self._asking.end(self._state.position + 1)

    def _next(self) -> Event | None:
        """Time first: it is over when it is over. Then what came, and then what is asked for here."""
        if self._is_restated:
            self._is_restated = False
            return Started()
        timer = self._timers.take()
        if timer is not None:
            return TimeOver(timer)
        event: Event | None = self._ahead.take(self._state.position)
        event = event or self._inbox.take()
        if isinstance(event, Received) and isinstance(event.message, Learn) and event.sender in self._state.judge.participants.nodes:
            self._ahead.keep(event, self._state.position)
        if event is None and self._state.proposal.stage is Stage.IDLE:
            event = self._asking.next(self._state, self._world.clock.now())
        return event

    def _ask_others(self, courier: Courier) -> None:
        asked, self._to_ask = sorted(self._to_ask), set()
        for other in asked:
            courier.send(other, AskLog(self.genesis, self._state.position))

    def _sync(self, courier: Courier, now: float) -> None:
        self._sync_at = now + SYNC_S * (0.8 + 0.4 * self._world.entropy.uniform())
        others = sorted(self._state.judge.participants.nodes - {self._setting.me.node})
        if others:
            one = others[int(self._world.entropy.uniform() * len(others))]
            courier.send(one, AskLog(self.genesis, self._state.position))

    async def _happen(self, courier: Courier, event: Event) -> None:
        before = self._state
        view = self._view(event)
        step = await self._step(event, view)
        if step.write is not None:
            try:
                await self._memory.write(step.write, before, step.after)
            except Refused:
                step = await self._step(event, replace(view, can_write=False))
                assert step.write is None, "who cannot write changes nothing"
            self._state = step.after
            self._owner.stands(step.after.slot, is_silent=self.is_silent)
        self._state = step.after
        self._count(before, step.after)
        for effect in step.effects:
            await self._carry_out(courier, effect, step.after)

    async def _step(self, event: Event, view: View) -> Step[State]:
        setting = self._memory.setting(self._state)
        if isinstance(event, Ask) or (isinstance(event, Received) and not isinstance(event.message, AskLog)):
            # A packet may bring some dozens of signatures, and a value be long.
            return await self._world.workers.run("crypto", take, setting, self._state, event, view)
        return take(setting, self._state, event, view)

    def _view(self, event: Event) -> View:
        now = self._world.clock.now()
        self._shunned = {node: until for node, until in self._shunned.items() if until > now}
        around = self._around
        # A node that lost its disk lives on as another one, which does not take part: to wait for that would be in vain each time.
        gone = {one.member.node for one in self._state.judge.participants.everyone if around.is_gone(one.member)}
        alive = (around.alive() - gone) | {self._setting.me.node}
        view = View(now, around.line(), around.reachable() - self._shunned.keys() - gone, alive)
        if not isinstance(event, Received) or not isinstance(event.message, Propose):
            return view
        message, is_carried = event.message, event.sender in self._state.judge.participants.nodes
        if message.genesis != self.genesis or message.proposal.position != self._state.position + 1:
            return view
        if message.proposal.phase is Phase.ACCEPT:
            return replace(view, abstains=message.value is not None and self._owner.abstains(message.value))
        # Nobody but participants carries proposals; and the owner may do something about one that is for him to consent to, or that asks nobody.
        if is_carried and message.takeover and message.value is not None:
            self._owner.insisted(message.value)
        return replace(view, veto=self._owner.veto(message.value) if is_carried else None)

    def _count(self, before: State, after: State) -> None:
        was, proposal = before.proposal, after.proposal
        self.taken_over += was.stage is Stage.IDLE and proposal.stage is not Stage.IDLE and not proposal.is_asked

    async def _carry_out(self, courier: Courier, effect: Effect, after: State) -> None:
        match effect:
            case Decide():
                self._owner.decided(effect, after.judge)
            case Send(target, message):
                courier.send(target, message)
            case Tell(target, above):
                await self._tell(courier, target, above)
            case SetTimer(timer, least_s, most_s):
                self._timers.set(timer, least_s, most_s)
                self._timers.forget_hops({hop.proposal for hop in after.hops})
            case Reply():
                if not self._asking.hear(effect):
                    self._owner.settled(effect)

    async def _tell(self, courier: Courier, target: NodeId, above: int) -> None:
        """As much as fits, and the newest."""
        found = list(await self._store.decided(self.genesis, above, TELL_MAX, TELL_BYTES_MAX))
        if found and found[-1].position < self._state.position:
            found += await self._store.decided(self.genesis, self._state.position - 1, 1, 0)
        for position, value, certificate in found:
            courier.send(target, Learn(self.genesis, position, value, certificate))


async def open_log(
    world: World,
    store: Store,
    setting: Setting,
    judge: Judge,
    carrier: Carrier,
    around: Surroundings,
    owner: Owner | None = None,
    *,
    position: int = 0,
) -> Log:
    """A log as this node's disk knows it, to be run. `judge` knows all that is decided up to `position`, however it came to know.

    `setting`: the incarnation is the store's. DamagedData if what was decided makes no sense.
    """
    owner = Owner() if owner is None else owner
    memory = Memory(store, setting, owner)
    state = await memory.read(judge, position)
    return Log(world, store, setting, memory, state, carrier, around, owner)
