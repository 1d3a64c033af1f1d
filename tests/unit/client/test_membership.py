"""If this fails, a node that lies gets the authority's key sealed to keys of its own, or keeps a certificate from being renewed."""

from __future__ import annotations

import datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import trio

from scenefold.base.errors import DamagedData, LocalFault
from scenefold.base.ids import NodeId, address_of, node_id_of
from scenefold.client.membership import Membership
from scenefold.crypto import AUTHORITY_PURPOSE, Card
from scenefold.wire import Packet
from scenefold.wire.enrol_entries import Trust
from scenefold.wire.enrol_packets import Administer, Administered, Enrolled, RequestRenewal, RequestRoll, RespondRoll
from scenefold.wire.orders import Order
from scenefold.world.facts import Credential
from unit.peer.members_made import AUTHORITY, NEWCOMERS, NOW, TLS_KEYS, card_for

VOTER, OTHER, THIRD = (node_id_of(f"127.0.0.{number}") for number in (2, 3, 4))
NODE = f"node:{OTHER}"
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

    async def ask_any(self, packet: Packet, answer: object, **_: object) -> Packet:
        return await self.ask(address_of(OTHER if OTHER in self.answers else VOTER), packet, answer)

    async def patiently(self, ask: Any, **_: object) -> Any:
        return await ask()


def roll(*cards: Card, trusted: tuple[NodeId, ...] = ()) -> RespondRoll:
    return RespondRoll(cards=tuple(card.der for card in cards), invitations=(), trusted=trusted, revoked=())


def membership(nodes: Nodes, folder: Path, kept: list[bytes]) -> Membership:
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
        user_certificate=lambda: card_for("user:ada", 0).der,
        keep_user_certificate=kept.append,
    )
    return Membership(nodes, profile, NEWCOMERS[0])  # type: ignore[arg-type]


async def sealed_to(node: NodeId, nodes: Nodes, folder: Path) -> bytes:
    (folder / "authority").mkdir()
    (folder / "authority" / "key.pem").touch()
    await membership(nodes, folder, []).trust(node)
    order = Order.decode(next(packet for packet in nodes.asked if isinstance(packet, Administer)).order)
    assert isinstance(order.entry, Trust)
    return order.entry.sealed


async def test_the_authoritys_key_is_sealed_to_the_keys_that_the_voter_names(tmp_path: Path) -> None:
    nodes = Nodes(NOW, {VOTER: roll(card_for(NODE, 1)), OTHER: roll(card_for(NODE, 0))})
    sealed = await sealed_to(OTHER, nodes, tmp_path)
    assert NEWCOMERS[1].sealing.open(sealed, AUTHORITY_PURPOSE, bytes(16)) == AUTHORITY.key_der()


async def test_a_node_that_was_there_from_the_start_has_the_keys_in_the_profile(tmp_path: Path) -> None:
    sealed = await sealed_to(THIRD, Nodes(NOW, {VOTER: roll()}), tmp_path)
    assert NEWCOMERS[2].sealing.open(sealed, AUTHORITY_PURPOSE, bytes(16)) == AUTHORITY.key_der()


async def test_a_node_that_nobody_knows_is_sealed_nothing(tmp_path: Path) -> None:
    with pytest.raises(LocalFault):
        await sealed_to(OTHER, Nodes(NOW, {VOTER: roll()}), tmp_path)


def enrolled(since: datetime.timedelta) -> Enrolled:
    pem = AUTHORITY.certify("user:ada", [], TLS_KEYS[0], keys=NEWCOMERS[0].public(), now=NOW + since)
    return Enrolled(certificate=Card.verified(pem, AUTHORITY.certificate).der, authority=b"", charter=b"")


class TrustedNodes(Nodes):
    async def ask_any(self, packet: Packet, answer: object, **_: object) -> Packet:
        await trio.lowlevel.checkpoint()
        return roll(trusted=(VOTER, OTHER)) if isinstance(packet, RequestRoll) else await super().ask_any(packet, answer)


async def test_a_trusted_node_with_a_wrong_clock_does_not_keep_others_from_renewing(tmp_path: Path) -> None:
    kept: list[bytes] = []
    nodes = TrustedNodes(NOW + 300 * DAY, {VOTER: enrolled(600 * DAY), OTHER: enrolled(300 * DAY)})
    newer = await membership(nodes, tmp_path, kept).renew()
    assert newer is not None and newer.der == nodes.answers[OTHER].certificate
    assert len(kept) == 1 and nodes.shown == kept
    assert sum(isinstance(packet, RequestRenewal) for packet in nodes.asked) == 2


async def test_a_certificate_that_is_not_believed_is_not_kept(tmp_path: Path) -> None:
    kept: list[bytes] = []
    nodes = TrustedNodes(NOW + 300 * DAY, {VOTER: enrolled(600 * DAY), OTHER: enrolled(-DAY)})
    with pytest.raises(DamagedData):
        await membership(nodes, tmp_path, kept).renew()
    assert not kept and not nodes.shown
