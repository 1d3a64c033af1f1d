"""If this fails, voters do not decide a cluster's log with the shell that scenes' logs run in, or do not find it on their disks again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
import trio

from scenefold.base.errors import Refused, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.consensus import Judge, Learn, Message, Outcome, Setting, Slot, Value
from scenefold.peer.cluster_log.cluster_judge import ClusterJudge, value_of
from scenefold.peer.cluster_log.lease_desk import LeaseDesk
from scenefold.peer.cluster_log.lease_grants import Question
from scenefold.peer.cluster_log.numbered_lives import Life
from scenefold.peer.cluster_log.registry import Registry
from scenefold.peer.cluster_log.voter_owner import VoterOwner
from scenefold.peer.logs import Log, open_log
from scenefold.store import open_store
from scenefold.wire import AddNode, AddParticipant, LogEntry, LogRecord, Member, RemoveNode, RemoveParticipant
from scenefold.world.sim import SimNet, run_simulated
from unit.peer.logs_made import add, found, key_of, node, record
from unit.peer.voters_made import GENESIS, request_of, trusted

FOLDER = Path("/data")


@dataclass
class Host:
    """A node's log while it runs."""

    log: Log
    desk: LeaseDesk
    scope: trio.CancelScope
    gone: trio.Event


class Assembly:
    """Nodes whose log goes from the key's to votes; packets take a moment, and come."""

    def __init__(self, seed: int, nursery: trio.Nursery, count: int) -> None:
        self.net, self.nursery = SimNet(seed), nursery
        self.numbers = {node(number): number for number in range(count)}
        self.members: dict[int, Member] = {}
        self.hosts: dict[int, Host] = {}
        self.first = Registry()

    async def found(self) -> None:
        """The incarnations are those of the stores; behind the last record that is made here, votes decide."""
        for one, number in self.numbers.items():
            async with open_store(self._world(number), FOLDER, one) as store:
                self.members[number] = Member(one, store.identity.incarnation)
        entries: list[LogEntry] = [found(len(self.members)), *map(self.added, self.members), *map(trusted, self.members), self.named(0)]
        for entry in entries:
            self.first = self.first.apply(record(self.first, entry))

    def added(self, number: int) -> AddNode:
        return replace(add(number), member=self.members[number])

    def named(self, number: int) -> AddParticipant:
        return AddParticipant(self.members[number], key_of(number).public.raw)

    async def start(self, *numbers: int) -> None:
        for number in numbers:
            await self.nursery.start(self._live, number)

    async def stop(self, *numbers: int) -> None:
        for number in numbers:
            host = self.hosts.pop(number)
            host.scope.cancel()
            await host.gone.wait()

    async def _live(self, number: int, *, task_status: trio.TaskStatus[None]) -> None:
        gone = trio.Event()
        try:
            with trio.CancelScope() as scope:
                async with open_store(self._world(number), FOLDER, node(number)) as store, trio.open_nursery() as life:
                    setting, port = Setting(GENESIS, self.members[number], key_of(number)), _Port(self, number)
                    judge, owner = ClusterJudge(self.first), VoterOwner(self._world(number))
                    log = await open_log(self._world(number), store, setting, judge, port, port, owner, position=self.first.position)
                    desk = LeaseDesk(self._world(number), store, setting.me, lambda: _registry(log), lambda: owner.has_accepted)
                    await desk.load()
                    owner.desk, desk.woke = desk, log.restate
                    life.start_soon(owner.run)
                    await life.start(log.run)
                    self.hosts[number] = Host(log, desk, scope, gone)
                    task_status.started()
                    await trio.sleep_forever()
        finally:
            gone.set()

    def _world(self, number: int):  # type: ignore[no-untyped-def]
        return self.net.world(f"node:{node(number)}", address_of(node(number)))

    def registry(self, number: int) -> Registry:
        return _registry(self.hosts[number].log)

    def wake(self, number: int, *others: int) -> None:
        """Others say that they know of no later life of this node."""
        for other in others:
            self.hosts[number].desk.heard(self.members[other], is_refused=False)

    async def tell(self, *numbers: int) -> None:
        """These hear lives of all whom they have to ask, and who tell."""
        await trio.sleep(1.0)
        for number in numbers:
            desk = self.hosts[number].desk
            at, asked = desk.to_ask()
            for other in asked:
                host = self.hosts.get(self.numbers[other.node])
                if host is not None:
                    await desk.told(other, at, host.desk.tell(at))

    async def decide(self, number: int, entry: LogEntry, request: str) -> int:
        """By this voter; the position."""
        answer = await self.hosts[number].log.ask(made(entry, request, node(number)), 30.0)
        assert answer.outcome is Outcome.COMMITTED, answer
        return answer.position

    async def equal(self, *numbers: int) -> None:
        with trio.fail_after(60):
            while len({self.registry(number).head for number in numbers}) > 1:  # noqa: ASYNC110 - logs tell nobody
                await trio.sleep(0.1)


def _registry(log: Log) -> Registry:
    assert isinstance(log.judge, ClusterJudge)
    return log.judge.registry


def made(entry: LogEntry, request: str, origin: NodeId) -> Callable[[Judge], Value]:
    """What a voter asks for at whatever position is open."""

    def make(judge: Judge) -> Value:
        assert isinstance(judge, ClusterJudge)
        registry = judge.registry
        return value_of(LogRecord(registry.position + 1, registry.head, request_of(request), origin, entry))

    return make


class _Port:
    """Ports `Carrier` and `Surroundings` of one node."""

    def __init__(self, assembly: Assembly, number: int) -> None:
        self._assembly, self._me = assembly, number

    async def send(self, target: NodeId, message: Message, /, *more: Learn) -> None:
        await trio.sleep(0.01)
        there = self._assembly.hosts.get(self._assembly.numbers[target])
        if there is None:
            raise Unreachable("nobody listens there", where=address_of(target))
        for one in (message, *more):
            there.log.receive(node(self._me), one)

    def line(self) -> tuple[NodeId, ...]:
        return tuple(self._assembly.numbers)

    def reachable(self) -> frozenset[NodeId]:
        return frozenset(node(number) for number in self._assembly.hosts if number != self._me)

    def alive(self) -> frozenset[NodeId]:
        return self.reachable()

    def is_gone(self, _member: Member) -> bool:
        return False


def test_voters_decide_and_find_what_they_decided_on_their_disks() -> None:
    async def main() -> None:
        async with trio.open_nursery() as nursery:
            assembly = Assembly(1, nursery, 4)
            await assembly.found()
            await assembly.start(0, 1, 2)
            first = await assembly.decide(0, assembly.named(1), "one more")
            assert first == assembly.first.position + 1
            assembly.wake(1, 0)
            await assembly.tell(1)
            await assembly.decide(0, assembly.named(2), "and another one")
            await assembly.equal(0, 1, 2)
            assembly.wake(2, 0, 1)
            await assembly.tell(0, 1, 2)
            await assembly.stop(0)
            gone = RemoveNode(assembly.members[3], "never heard")
            at = await assembly.decide(1, gone, "gone")
            assert await assembly.decide(2, gone, "gone") == at, "the same request, at another voter"
            await assembly.decide(2, RemoveParticipant(assembly.members[0]), "away")
            await assembly.equal(1, 2)
            await assembly.tell(1, 2)
            head = assembly.registry(1).head
            await assembly.stop(1, 2)
            await assembly.start(1, 2, 0)
            assert assembly.registry(1).head == assembly.registry(2).head == head
            assert assembly.registry(1).voters == (node(1), node(2)) and not assembly.registry(1).stands(node(3))
            await assembly.equal(0, 1, 2)
            assert assembly.hosts[0].log.is_silent, "it votes no more"
            nursery.cancel_scope.cancel()

    run_simulated(1, main, virtual_s_max=600, wall_s_max=100)


def test_who_is_not_ready_does_not_vote_for_other_voters_and_who_has_voted_grants_nothing() -> None:
    """The second voter is awake, and has not heard yet what the first one granted: both are needed, and it abstains."""

    async def main() -> None:
        async with trio.open_nursery() as nursery:
            assembly = Assembly(2, nursery, 4)
            await assembly.found()
            await assembly.start(0, 1, 2)
            one, other = assembly.hosts[0].desk, assembly.hosts[1].desk
            who = assembly.members[3]
            assert await one.grant(Question(who, assembly.first.position, Life(0, 5), 1))
            at = await assembly.decide(0, assembly.named(1), "one more")
            await assembly.equal(0, 1)
            assembly.wake(1, 0)
            asked = made(assembly.named(2), "and another one", node(0))
            answer = await assembly.hosts[0].log.ask(asked, 3.0)
            assert answer.outcome is Outcome.UNKNOWN and assembly.registry(0).position == at
            assert not await one.grant(Question(who, at, Life(0, 5), 2)), "it has voted"
            await assembly.tell(1)
            assert (await assembly.hosts[0].log.ask(asked, 30.0)).outcome is Outcome.COMMITTED
            await assembly.equal(0, 1)
            await assembly.tell(0, 1)
            assert await one.grant(Question(who, at + 1, Life(0, 5), 3)) and await other.grant(Question(who, at + 1, Life(0, 5), 4))
            nursery.cancel_scope.cancel()

    run_simulated(2, main, virtual_s_max=600, wall_s_max=100)


def test_what_nobody_has_judged_is_not_voted_for() -> None:
    async def main() -> None:
        async with trio.open_nursery() as nursery:
            assembly = Assembly(3, nursery, 2)
            await assembly.found()
            await assembly.start(0)
            owner = VoterOwner(assembly._world(0))
            owner.desk = assembly.hosts[0].desk
            assert owner.abstains(Value(b"what is that?")) and not owner.has_accepted
            with pytest.raises(Refused):
                owner.votes(Value(b"what is that?"))
            good = made(RemoveNode(assembly.members[1], "gone"), "gone", node(0))(assembly.hosts[0].log.judge)
            owner.votes(good)
            assert owner.has_accepted and not owner.abstains(good)
            owner.stands(Slot(), is_silent=False)
            assert not owner.has_accepted
            owner.stands(Slot(), is_silent=True)
            assert owner.has_accepted, "what it has said there it does not know"
            nursery.cancel_scope.cancel()

    run_simulated(3, main, virtual_s_max=600, wall_s_max=100)
