"""If this fails, users can send what only nodes may, or a node can speak in another's name."""

from __future__ import annotations

import pytest

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId
from scenefold.base.location import LAST
from scenefold.base.reasons import RejectReason
from scenefold.peer import Handlers, Senders, node_of
from scenefold.wire import ListScenes, MiniStatus, Packet, RequestTable, RevokeNode, ScenesListed
from unit.peer.logs_made import folded, found, key_of, node

MINI = MiniStatus(5, NodeId(1), LAST, 0, 0, 0, 0, 0)
REGISTRY = folded(found(2), RevokeNode(node(1), key_of(1).public.key_id))
NODE, USER = "node:2", "user:owner"


class Heard(list[MiniStatus]):
    """What the table told the roster."""


def a_table(heard: Heard | None = None) -> Handlers:
    return Handlers(lambda: REGISTRY, lambda: MINI, (Heard() if heard is None else heard).append)


async def answer(_packet: Packet, _peer: str) -> Packet:
    return ScenesListed(scenes=())


async def silence(_packet: Packet, _peer: str) -> None:
    return None


async def reason_of(table: Handlers, packet: Packet, peer: str) -> RejectReason:
    with pytest.raises(Refused) as caught:
        await table.handle(packet, peer)
    return caught.value.reason


async def test_the_handler_of_the_class_answers_and_our_state_is_on_it() -> None:
    table = a_table()
    table.add(ListScenes, answer)
    assert await table.handle(ListScenes(), USER) == ScenesListed(scenes=(), mini_status=MINI)


async def test_a_handler_may_be_silent() -> None:
    table = a_table()
    table.add(ListScenes, silence)
    assert await table.handle(ListScenes(), NODE) is None


async def test_nobody_answers_what_nobody_added() -> None:
    assert await reason_of(a_table(), RequestTable(), USER) == RejectReason.ILL_FORMED


@pytest.mark.parametrize("senders, allowed, refused", [(Senders.NODES, NODE, USER), (Senders.USERS, USER, NODE)])
async def test_who_may_not_send_it_is_refused(senders: Senders, allowed: str, refused: str) -> None:
    table = a_table()
    table.add(ListScenes, answer, senders=senders)
    assert await table.handle(ListScenes(), allowed) is not None
    assert await reason_of(table, ListScenes(), refused) == RejectReason.NOT_AUTHORISED


async def test_a_node_may_ask_before_it_is_a_member_unless_its_key_is_revoked() -> None:
    table = a_table()
    table.add(ListScenes, answer)
    assert await table.handle(ListScenes(), f"node:{node(7)}") is not None
    assert await reason_of(table, ListScenes(), f"node:{node(1)}") == RejectReason.KEY_REVOKED


@pytest.mark.parametrize("peer", ["node:x", "node:", "", "owner", "nodes:1"])
async def test_who_is_neither_node_nor_user_is_refused(peer: str) -> None:
    table = a_table()
    table.add(ListScenes, answer)
    assert await reason_of(table, ListScenes(), peer) == RejectReason.NOT_AUTHORISED


async def test_a_nodes_state_is_heard() -> None:
    heard = Heard()
    table = a_table(heard)
    table.add(ListScenes, answer)
    mini = MiniStatus(9, NodeId(2), LAST, 0, 0, 0, 0, 0)
    await table.handle(ListScenes(mini_status=mini), NODE)
    assert heard == [mini]


@pytest.mark.parametrize("peer", ["node:1", USER])
async def test_nobody_speaks_in_another_nodes_name(peer: str) -> None:
    heard = Heard()
    table = a_table(heard)
    table.add(ListScenes, answer)
    mini = MiniStatus(9, NodeId(2), LAST, 0, 0, 0, 0, 0)
    assert await reason_of(table, ListScenes(mini_status=mini), peer) == RejectReason.NOT_AUTHORISED
    assert heard == []


def test_one_class_has_one_handler() -> None:
    table = a_table()
    table.add(ListScenes, answer)
    with pytest.raises(AssertionError):
        table.add(ListScenes, answer)


@pytest.mark.parametrize(
    "name, number",
    [("node:7", 7), ("user:7", None), ("node:-7", None), ("", None), ("node:07", None), ("node:4294967296", None), ("node:٧", None)],
)
def test_a_certificate_name_says_which_node(name: str, number: int | None) -> None:
    assert node_of(name) == number
