"""If this fails, a whole node does not become a member, does not come back after it was removed, or takes two lives for one.

Whole nodes, as `scenectl node run` assembles them, in virtual time.
"""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest
import trio

from scenefold.base.ids import address_of
from scenefold.base.location import LAST
from scenefold.node import NodeContext, NodeSettings
from scenefold.node.running import run_assembled
from scenefold.peer import IdentityRenewed
from scenefold.peer.reporting import DROPPED, Reporting
from scenefold.wire import Member, RemoveNode
from scenefold.world import Priority, background_tasks
from scenefold.world.sim import SimNet, run_simulated
from unit.peer.logs_made import LOG_KEY, facts, node, secrets_of


@pytest.fixture(autouse=True)
def _in_silence(caplog: pytest.LogCaptureFixture) -> None:
    """What nodes say of each other's crashes is not the subject here."""
    caplog.set_level(logging.CRITICAL + 1, "scenefold")


class Machines:
    """Nodes by number; `contexts` are those of their newest lives."""

    def __init__(self, founders: int, spares: int, nursery: trio.Nursery) -> None:
        self.net = SimNet(7)
        self.facts = facts(founders, spares, self.net.ports)
        self.contexts: dict[int, NodeContext] = {}
        self.lives: dict[int, int] = {}
        self.blacklists: dict[int, list[int]] = {}
        self._scopes: dict[int, trio.CancelScope] = {}
        self._nursery = nursery

    async def start(self, *numbers: int) -> None:
        for number in numbers:
            await self._nursery.start(self._run, number)

    async def crash(self, number: int) -> None:
        self.net.crash(self.facts.credentials[number].address)
        self._scopes[number].cancel()
        await trio.sleep(1)

    async def joined(self, *numbers: int) -> None:
        with trio.fail_after(60):
            for number in numbers:
                await self.contexts[number].joined.wait()

    async def _run(self, number: int, *, task_status: trio.TaskStatus[None]) -> None:
        address = self.facts.credentials[number].address
        blacklist = tuple(address_of(node(other)) for other in self.blacklists.get(number, ()))
        settings = NodeSettings(
            profile_folder=Path("/profile"), address=address, data_folder=Path("/data"), seed_wait_s=600, blacklist=blacklist
        )
        log_key = LOG_KEY if number == 0 else None
        status: trio.TaskStatus[None] = task_status
        with trio.CancelScope() as self._scopes[number]:
            while True:
                world = self.net.world(f"node:{node(number)}", address)
                try:
                    async with background_tasks() as nursery:
                        self.contexts[number] = await nursery.start(run_assembled, settings, self.facts, secrets_of(number), log_key, world)
                        self.lives[number] = self.lives.get(number, 0) + 1
                        status.started()
                        status = trio.TASK_STATUS_IGNORED
                        await trio.sleep_forever()
                except IdentityRenewed:
                    continue


def simulate(scenario: Callable[[Machines], Awaitable[None]], founders: int = 3, spares: int = 0) -> None:
    async def main() -> None:
        async with background_tasks() as nursery:
            await scenario(Machines(founders, spares, nursery))

    run_simulated(7, main, virtual_s_max=3_600, wall_s_max=100)


def test_founders_join_and_own_their_arcs() -> None:
    async def scenario(machines: Machines) -> None:
        await machines.start(2, 0, 1)
        await machines.joined(0, 1, 2)
        await trio.sleep(10)
        for number, context in machines.contexts.items():
            assert context.lease.holds() and context.line.arc == context.cluster_log.registry.founding_arc(node(number))
            assert [status.right_bound for status in context.roster.statuses()].count(None) == 0
            assert context.routing.members == (node(0), node(1), node(2)) and context.routing.owner_of(LAST) == node(2)

    simulate(scenario)


def test_each_blacklist_stands_in_everybodys_table_and_settings_add_to_it() -> None:
    def tables(machines: Machines) -> list[dict[int, tuple[str, ...]]]:
        """Of each node: the blacklists of the others, as its table has them."""
        return [
            {status.node: tuple(map(str, status.blacklist)) for status in context.roster.statuses()}
            for context in machines.contexts.values()
        ]

    async def scenario(machines: Machines) -> None:
        machines.blacklists = {1: [2, 0], 2: [1]}
        await machines.start(0, 1, 2)
        await machines.joined(0, 1, 2)
        await trio.sleep(10)
        nobody: tuple[str, ...] = ()
        said = {node(0): nobody, node(1): (address_of(node(0)), address_of(node(2))), node(2): (address_of(node(1)),)}
        assert tables(machines) == [{other: said[other] for other in said if other != me} for me in said]
        await machines.crash(1)
        machines.blacklists = {1: [3], 2: [1]}
        await machines.start(1)
        await machines.joined(1)
        await trio.sleep(10)
        three = tuple(address_of(node(number)) for number in (0, 2, 3))
        assert {table[node(1)] for table in tables(machines) if node(1) in table} == {three}

    simulate(scenario)


def test_a_spare_joins_and_everybody_lists_it() -> None:
    async def scenario(machines: Machines) -> None:
        await machines.start(0, 1, 2)
        await machines.joined(0, 1, 2)
        await machines.start(3)
        await machines.joined(3)
        await trio.sleep(10)
        assert all(node(3) in context.routing.members for context in machines.contexts.values())
        assert all(context.roster.is_believed_alive(node(3)) for context in machines.contexts.values())

    simulate(scenario, spares=1)


def test_who_was_removed_while_it_was_away_comes_back_in_a_second_life() -> None:
    async def scenario(machines: Machines) -> None:
        await machines.start(0, 1, 2)
        await machines.joined(0, 1, 2)
        member = machines.contexts[2].own.member
        await machines.crash(2)
        with trio.fail_after(600):
            while machines.contexts[1].cluster_log.registry.is_current(member):
                await machines.contexts[1].cluster_log.changed_after(machines.contexts[1].cluster_log.registry.position)
        removal = machines.contexts[1].cluster_log.registry.removal(member.incarnation)
        assert removal is not None and removal.reason, "somebody says why"
        await machines.start(2)
        await trio.sleep(20)
        await machines.joined(2)
        again = machines.contexts[2].own.member
        assert machines.lives[2] == 3 and again.incarnation != member.incarnation
        assert machines.contexts[0].cluster_log.registry.is_current(again)

    simulate(scenario)


def test_leaving_ends_the_lease_of_a_running_node_at_once() -> None:
    async def scenario(machines: Machines) -> None:
        await machines.start(0, 1, 2)
        await machines.joined(0, 1, 2)
        first = machines.contexts[1]
        await first.cluster_log.propose(RemoveNode(Member(node(1), first.own.incarnation), "leaving"))
        assert not first.lease.holds()
        await trio.sleep(30)
        assert machines.lives[1] == 2 and machines.contexts[1].lease.holds()

    simulate(scenario)


@pytest.mark.parametrize("priority", list(Priority))
def test_what_either_port_drops_stands_in_the_report(priority: Priority) -> None:
    async def scenario(machines: Machines) -> None:
        await machines.start(0)
        await machines.joined(0)
        context = machines.contexts[0]
        stranger = await machines.net.world("user:eve", "127.0.0.99").network.open_datagrams(None, priority)
        before = await dropped(context)
        for _ in range(3):
            await stranger.send(b"noise", context.address)
        await trio.sleep(1)
        assert await dropped(context) == before + 3

    async def dropped(context: NodeContext) -> int:
        return int((await Reporting(context).report())["events"][DROPPED])

    simulate(scenario, founders=1)
