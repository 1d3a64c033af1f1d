"""If this fails, a client lets a node render by a certificate that nobody has to believe, or by a log that it has not asked for anew."""

from __future__ import annotations

import datetime
from collections.abc import Iterable
from types import SimpleNamespace
from typing import Any

import pytest
import trio

from scenefold.base.errors import LocalFault, Refused, Unreachable
from scenefold.base.ids import NodeId, address_of, node_id_of
from scenefold.crypto import Authority, Card
from scenefold.render.choice import REVOKED, STRANGE, Renderers
from scenefold.render.choosing import renderers_of
from scenefold.wire import AddNode, LogEntry, Member, RevokeNode
from scenefold.wire.enrol_entries import ANY_NODE, Invite, Trust
from unit.peer.logs_made import add, facts, found, incarnation, key_of, node, secrets_of
from unit.peer.members_made import AUTHORITY, NEWCOMERS, NOW, TLS_KEYS, card_for, enrolled, invitation_key
from unit.render.test_choice import granted, trust, view_of

NEWCOMER = NodeId(node_id_of("127.0.0.9"))
NAME = f"node:{NEWCOMER}"
FOUNDED: tuple[LogEntry, ...] = (found(3), add(0), add(1), add(2))


class Cluster:
    """What a client knows, and of whom it asks for a card."""

    def __init__(self, *entries: LogEntry, cards: dict[str, Card] | None = None) -> None:
        self.asked: list[str] = []
        self._entries, self._cards = entries, cards or {}
        self.profile = SimpleNamespace(members=facts(3).credentials, authority_certificate=lambda: AUTHORITY.certificate)
        now = NOW + datetime.timedelta(days=1)
        self.calls = SimpleNamespace(world=SimpleNamespace(clock=SimpleNamespace(wall=now.timestamp)))
        self.log = SimpleNamespace(newest=self._newest)

    async def _newest(self) -> Any:
        await trio.lowlevel.checkpoint()
        self.asked.append("log")
        return view_of(*self._entries)

    async def in_worker(self, _lane: str, function: Any, *args: object) -> Any:
        await trio.lowlevel.checkpoint()
        return function(*args)

    async def card_of(self, name: str) -> Card:
        await trio.lowlevel.checkpoint()
        self.asked.append(name)
        if name not in self._cards:
            raise LocalFault("there is no such member")
        return self._cards[name]


async def renderers(cluster: Cluster, *grants: Any, away: bool = False, met: int = 5, positions: Iterable[int] = (5, 5, 5)) -> Renderers:
    """`met`: the scene's position, by all headers; `positions`: those of its log, whenever it is read."""
    logs = iter(positions)

    async def read_log() -> Any:
        await trio.lowlevel.checkpoint()
        if away:
            raise Unreachable("the node that keeps the scene's log does not answer")
        return SimpleNamespace(header=SimpleNamespace(position=next(logs)), state=SimpleNamespace(grants=SimpleNamespace(members=grants)))

    scene: Any = SimpleNamespace(name="room", access=SimpleNamespace(read_log=read_log, identity=SimpleNamespace(position=met)))
    return await renderers_of(cluster, scene)  # type: ignore[arg-type]


def why(seen: Renderers) -> dict[NodeId, str]:
    return {one.node: one.why for one in seen.left_out}


async def test_founders_are_known_by_log_and_profile_and_nobody_is_asked_for_cards() -> None:
    cluster = Cluster(*FOUNDED, trust(1))
    seen = await renderers(cluster, granted(2))
    assert seen.nodes == (node(0), node(1), node(2)) and not seen.left_out
    assert cluster.asked == ["log"]
    assert seen.sealing[node(1)] == secrets_of(1).sealing.public


async def test_the_log_is_asked_for_anew_each_time() -> None:
    cluster = Cluster(*FOUNDED, trust(1))
    assert (await renderers(cluster)).nodes == (node(0), node(1))
    cluster._entries = (*FOUNDED, trust(1), Trust(node(1), False))
    assert why(await renderers(cluster))[node(1)] == STRANGE
    assert cluster.asked == ["log", "log"]


async def test_without_the_scenes_log_nobody_is_chosen() -> None:
    with pytest.raises(Unreachable):
        await renderers(Cluster(*FOUNDED), away=True)


async def test_nobody_is_chosen_by_a_log_that_is_older_than_the_keys() -> None:
    with pytest.raises(Refused, match="older here than what is known"):
        await renderers(Cluster(*FOUNDED), granted(1), met=6)


async def test_a_newer_header_that_was_met_meanwhile_has_the_log_read_again() -> None:
    assert (await renderers(Cluster(*FOUNDED), granted(1), met=6, positions=(5, 6))).nodes == (node(0), node(1))


async def test_a_revoked_founder_is_left_out() -> None:
    revoked = RevokeNode(node(1), key_of(1).public.key_id)
    assert why(await renderers(Cluster(*FOUNDED, trust(1), revoked), granted(1)))[node(1)] == REVOKED


def _joined(card: Card | None, keys: int = 0) -> tuple[LogEntry, ...]:
    """A node that was invited and enrolled with this card, if with any, is a member under these keys, and trusted."""
    own = NEWCOMERS[keys].public()
    until = int((NOW + datetime.timedelta(days=7)).timestamp())
    invite = Invite(invitation_key(1).public.raw, ANY_NODE, False, until, "user:owner")
    member = AddNode(Member(NEWCOMER, incarnation(9)), own.signing.raw, own.sealing.raw, address_of(NEWCOMER), node(0))
    joined = () if card is None else (invite, enrolled(1, card))
    return (*FOUNDED, *joined, member, Trust(NEWCOMER, True, own.sealing.raw))


async def test_who_joined_is_known_by_the_card_that_the_authority_issued() -> None:
    card = card_for(NAME, 0)
    seen = await renderers(Cluster(*_joined(card)))
    assert seen.nodes == (NEWCOMER, node(0)) and seen.sealing[NEWCOMER] == card.keys.sealing


async def test_a_card_of_another_authority_or_out_of_date_lets_nobody_render() -> None:
    stranger = Authority.create("studio", now=NOW)
    pem = stranger.certify(NAME, [address_of(NEWCOMER)], TLS_KEYS[0], keys=NEWCOMERS[0].public(), now=NOW)
    old = card_for(NAME, 0, since=-datetime.timedelta(days=500))
    for card in (Card.verified(pem, stranger.certificate), old):
        seen = await renderers(Cluster(*_joined(card)))
        assert seen.nodes == (node(0),) and why(seen)[NEWCOMER].startswith("its certificate: ")


async def test_a_member_under_other_keys_than_those_of_its_card_is_left_out() -> None:
    """As if who decides the log had let in somebody else under that name."""
    assert (await renderers(Cluster(*_joined(card_for(NAME, 0), keys=1)))).nodes == (node(0),)


async def test_of_whom_neither_log_nor_profile_knows_a_certificate_one_is_asked_for() -> None:
    """Somebody who was invited has no list of those nodes whose keys were made with the cluster, and that joined later."""
    for cards, nodes in (
        ({NAME: card_for(NAME, 0)}, (NEWCOMER, node(0))),
        ({NAME: card_for(NAME, 1)}, (node(0),)),
        ({}, (node(0),)),
    ):
        cluster = Cluster(*_joined(None), cards=cards)
        assert (await renderers(cluster)).nodes == nodes
        assert cluster.asked == ["log", NAME]
