"""If this fails, a node that lies gets the authority's key sealed to keys of its own, or keeps a certificate from being renewed."""

from __future__ import annotations

import datetime
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import trio

from scenefold.base.errors import DamagedData, LocalFault, Refused
from scenefold.base.ids import NodeId, address_of, node_id_of
from scenefold.base.reasons import RejectReason
from scenefold.client.membership import Membership
from scenefold.client.orders import Orders
from scenefold.crypto import AUTHORITY_PURPOSE, Card
from scenefold.wire import Packet
from scenefold.wire.enrol_entries import RevokeUser, Trust
from scenefold.wire.enrol_packets import Administer, Administered, Enrolled, RequestRenewal, RespondCard
from scenefold.wire.orders import Order
from scenefold.world.facts import Credential
from scenefold.world.log_view import LogView, NodeKeys
from scenefold.world.roll import Roll
from unit.peer.members_made import AUTHORITY, NEWCOMERS, NOW, TLS_KEYS, card_for

VOTER, OTHER, THIRD = (node_id_of(f"127.0.0.{number}") for number in (2, 3, 4))
NODE = f"node:{OTHER}"
SECOND_LIFE = b"2" * 16
DAY = datetime.timedelta(days=1)


class Nodes:
    """What a client asks; each node answers as the test says."""

    def __init__(self, now: datetime.datetime, answers: dict[NodeId, Any]) -> None:
        self.answers = answers
        self.asked: list[Packet] = []
        self.shown: list[bytes] = []
        self.world = SimpleNamespace(
            clock=SimpleNamespace(wall=now.timestamp),
            entropy=SimpleNamespace(token=bytes),
            workers=SimpleNamespace(run=self._run),
            network=SimpleNamespace(show=self.shown.append),
        )

    async def _run(self, _lane: str, function: Any, *args: object) -> Any:
        await trio.lowlevel.checkpoint()
        return function(*args)

    async def ask(self, address: str, packet: Packet, _answer: object, **_: object) -> Packet:
        await trio.lowlevel.checkpoint()
        self.asked.append(packet)
        if isinstance(packet, Administer):
            return Administered(position=1)
        answer: Packet = self.answers[node_id_of(address)]
        return answer

    async def patiently(self, ask: Any, **_: object) -> Any:
        return await ask()


def keys_of(who: int) -> NodeKeys:
    public = NEWCOMERS[who].public()
    return NodeKeys(public.signing.raw, public.sealing.raw)


class Log:
    """The cluster's log, as several nodes have shown it."""

    def __init__(self, view: LogView) -> None:
        self.view = view
        self.voters = (VOTER,)

    def has_grown(self) -> None:
        pass

    async def newest(self, *, age_s_max: float = 0.0) -> LogView:
        del age_s_max
        await trio.lowlevel.checkpoint()
        return self.view


def enrolled_as(*cards: Card) -> LogView:
    return LogView(roll=Roll(cards={card.name: card for card in cards}))


def membership(nodes: Nodes, folder: Path, kept: list[bytes], view: LogView) -> Membership:
    keys = NEWCOMERS[2].public()
    profile = SimpleNamespace(
        folder=folder,
        user="ada",
        name="studio",
        cluster_id=bytes(16),
        voters=(VOTER,),
        members=(Credential(THIRD, address_of(THIRD), keys.signing, keys.sealing),),
        authority=lambda: AUTHORITY,
        authority_certificate=lambda: AUTHORITY.certificate,
        owners=lambda: (),
        user_certificate=lambda: card_for("user:ada", 0).der,
        keep_user_certificate=kept.append,
    )
    log: Any = Log(view)
    orders = Orders(nodes, profile.cluster_id, "user:ada", NEWCOMERS[0].signing, log)  # type: ignore[arg-type]
    return Membership(nodes, profile, NEWCOMERS[0], log, orders)  # type: ignore[arg-type]


async def trust_in(node: NodeId, view: LogView, folder: Path) -> Trust:
    """What an administrator orders who has the authority's key."""
    nodes = Nodes(NOW, {})
    (folder / "authority").mkdir()
    (folder / "authority" / "key.pem").touch()
    await membership(nodes, folder, [], view).trust(node)
    order = Order.decode(next(packet for packet in nodes.asked if isinstance(packet, Administer)).order)
    assert isinstance(order.entry, Trust)
    return order.entry


@pytest.mark.parametrize(
    "node, view, who",
    [
        (OTHER, enrolled_as(card_for(NODE, 1)), 1),
        (OTHER, LogView(nodes={OTHER: keys_of(1)}), 1),
        (OTHER, LogView(nodes={OTHER: keys_of(0)}, roll=Roll(cards={NODE: card_for(NODE, 1)})), 1),
        (THIRD, LogView(), 2),
    ],
    ids=["enrolled by a token", "there from the start", "back under other keys", "certified and never come"],
)
async def test_the_authoritys_key_is_sealed_to_the_keys_that_the_log_names(node: NodeId, view: LogView, who: int, tmp_path: Path) -> None:
    entry = await trust_in(node, view, tmp_path)
    assert entry.sealing_key == NEWCOMERS[who].sealing.public.raw
    assert NEWCOMERS[who].sealing.open(entry.sealed, AUTHORITY_PURPOSE, bytes(16)) == AUTHORITY.key_der()


def on_line(*order: NodeId, trusted: tuple[NodeId, ...] = (), revoked: tuple[NodeId, ...] = ()) -> LogView:
    """All of these have keys, and stand on the line but for a revoked one's."""
    roll = Roll(trusted=frozenset(trusted), revoked=frozenset((f"node:{node}", keys_of(1).signing_id) for node in revoked))
    return LogView(
        nodes=dict.fromkeys((VOTER, OTHER, THIRD), keys_of(1)), order=order, registered=dict.fromkeys(order, SECOND_LIFE), roll=roll
    )


def trusted_by(nodes: Nodes) -> list[NodeId]:
    entries = [Order.decode(packet.order).entry for packet in nodes.asked if isinstance(packet, Administer)]
    return [entry.node for entry in entries if isinstance(entry, Trust)]


@pytest.mark.parametrize(
    "view, expected",
    [
        (on_line(VOTER, THIRD, OTHER, trusted=(VOTER,)), [THIRD, OTHER]),
        (on_line(VOTER, THIRD, trusted=(VOTER,)), [THIRD]),
        (on_line(VOTER, OTHER, THIRD, revoked=(OTHER, THIRD, VOTER)), []),
    ],
    ids=["in the order of the line", "not one that was drained and has keys still", "no revoked one"],
)
async def test_all_are_those_that_the_log_has_on_the_line(view: LogView, expected: list[NodeId], tmp_path: Path) -> None:
    nodes = Nodes(NOW, {})
    assert await membership(nodes, tmp_path, [], view).trust_all() == expected == trusted_by(nodes)


async def test_if_one_cannot_be_trusted_it_is_told_who_is_by_now(tmp_path: Path) -> None:
    class Failing(Nodes):
        async def ask(self, address: str, packet: Packet, answer: object, **options: object) -> Packet:
            if trusted_by(self) == [THIRD]:
                raise Refused(RejectReason.BUSY, "too many orders")
            return await super().ask(address, packet, answer, **options)

    with pytest.raises(Refused) as caught:
        await membership(Failing(NOW, {}), tmp_path, [], on_line(VOTER, THIRD, OTHER, trusted=(VOTER,))).trust_all()
    assert address_of(OTHER) in str(caught.value) and f"trusted before it: {address_of(THIRD)}" in str(caught.value)


def ordered_by(nodes: Nodes) -> list[Any]:
    return [Order.decode(packet.order).entry for packet in nodes.asked if isinstance(packet, Administer)]


@pytest.mark.parametrize(
    "node, view",
    [
        (OTHER, LogView()),
        (OTHER, LogView(nodes={OTHER: keys_of(1)}, roll=Roll(revoked=frozenset({(NODE, keys_of(1).signing_id)})))),
        (THIRD, LogView(roll=Roll(revoked=frozenset({(f"node:{THIRD}", keys_of(2).signing_id)})))),
    ],
    ids=["nobody", "revoked", "certified and revoked"],
)
async def test_a_node_without_keys_that_count_is_sealed_nothing(node: NodeId, view: LogView, tmp_path: Path) -> None:
    with pytest.raises(LocalFault):
        await trust_in(node, view, tmp_path)


async def shown(card: Card, view: LogView, folder: Path) -> Card:
    """The card of OTHER, which shows this one."""
    return await membership(Nodes(NOW, {OTHER: RespondCard(card=card.der)}), folder, [], view).card_of(NODE)


async def test_a_node_that_was_there_from_the_start_shows_its_card_and_no_other_keys(tmp_path: Path) -> None:
    view = LogView(nodes={OTHER: keys_of(1)})
    assert await shown(card_for(NODE, 1), view, tmp_path) == card_for(NODE, 1)
    for wrong in (card_for(NODE, 0), card_for(f"node:{THIRD}", 1)):
        with pytest.raises(DamagedData):
            await shown(wrong, view, tmp_path)


async def test_nobody_shows_the_card_of_a_revoked_member(tmp_path: Path) -> None:
    for name, view in (
        ("user:ada", enrolled_as(card_for("user:ada", 1))),
        (NODE, LogView(nodes={OTHER: keys_of(1)})),
    ):
        revoked = replace(view, roll=view.roll.without(name, keys_of(1).signing_id))
        nodes = Nodes(NOW, {OTHER: RespondCard(card=card_for(NODE, 1).der)})
        assert (await membership(nodes, tmp_path, [], view).card_of(name)).name == name
        with pytest.raises(LocalFault, match="is revoked"):
            await membership(nodes, tmp_path, [], revoked).card_of(name)


async def test_a_user_whose_certificate_has_run_out_can_be_revoked(tmp_path: Path) -> None:
    """The keys may count still, under a certificate that was issued where nobody asks the log."""
    card, nodes = card_for("user:eve", 1), Nodes(NOW + 800 * DAY, {})
    await membership(nodes, tmp_path, [], enrolled_as(card)).revoke_user("eve")
    assert ordered_by(nodes) == [RevokeUser("user:eve", card.signing_id)]
    with pytest.raises(LocalFault, match="is no member"):
        await membership(nodes, tmp_path, [], enrolled_as(card)).revoke_user("ben")


def enrolled(since: datetime.timedelta) -> Enrolled:
    pem = AUTHORITY.certify("user:ada", [], TLS_KEYS[0], keys=NEWCOMERS[0].public(), now=NOW + since)
    return Enrolled(certificate=Card.verified(pem, AUTHORITY.certificate).der, authority=b"", charter=b"")


TRUSTED = LogView(roll=Roll(trusted=frozenset({VOTER, OTHER})))


async def test_a_trusted_node_with_a_wrong_clock_does_not_keep_others_from_renewing(tmp_path: Path) -> None:
    kept: list[bytes] = []
    nodes = Nodes(NOW + 300 * DAY, {VOTER: enrolled(600 * DAY), OTHER: enrolled(300 * DAY)})
    newer = await membership(nodes, tmp_path, kept, TRUSTED).renew()
    assert newer is not None and newer.der == nodes.answers[OTHER].certificate
    assert len(kept) == 1 and nodes.shown == kept
    assert sum(isinstance(packet, RequestRenewal) for packet in nodes.asked) == 2


async def test_a_certificate_that_is_not_believed_is_not_kept(tmp_path: Path) -> None:
    kept: list[bytes] = []
    nodes = Nodes(NOW + 300 * DAY, {VOTER: enrolled(600 * DAY), OTHER: enrolled(-DAY)})
    with pytest.raises(DamagedData):
        await membership(nodes, tmp_path, kept, TRUSTED).renew()
    assert not kept and not nodes.shown
