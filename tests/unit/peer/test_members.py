"""If this fails, clients do not learn whom to ask, or nodes tell each other tables of nothing."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import trio

from scenefold.peer.membership.members import Members
from scenefold.wire import RequestTable, RespondTable
from unit.peer.village import node_at, village


async def test_users_are_told_of_all_and_nodes_of_who_was_heard(autojump_clock: trio.testing.MockClock) -> None:
    async with village(5) as them:
        await them.start(0)
        await them.start(1)
        await trio.sleep(3)
        node = them.of(0)
        handlers: dict[Any, Any] = {}
        table = SimpleNamespace(add=lambda packet, handler: handlers.update({packet: handler}))
        Members(node.own, node.roster, lambda: node.log.registry).register(cast(Any, table))
        ask = handlers[RequestTable]
        for_users = await ask(RequestTable(), "user:ada")
        for_nodes = await ask(RequestTable(), f"node:{node_at(3)}")
        assert isinstance(for_users, RespondTable) and isinstance(for_nodes, RespondTable)
        assert [status.node for status in for_users.statuses] == [node_at(index) for index in range(5)]
        assert [status.node for status in for_nodes.statuses] == [node_at(0), node_at(1)]
        assert all(status.signature for status in for_nodes.statuses)
