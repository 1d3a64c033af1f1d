"""If this fails, a scene is granted to somebody else than a person meant, or to nobody."""

from __future__ import annotations

import datetime
from pathlib import Path
from types import SimpleNamespace

import pytest

from scenefold.base.errors import DamagedData, LocalFault, UsageFault
from scenefold.client.cards import card_for, member_name
from scenefold.client.grants import role_named
from scenefold.crypto import Authority, Card, MemberKeys
from scenefold.wire import Role
from scenefold.world.log_view import LogView
from scenefold.world.roll import Roll
from unit.client.test_membership import NODE, OTHER, Log, Nodes, enrolled_as, keys_of, membership
from unit.peer.members_made import AUTHORITY, NEWCOMERS, NOW, TLS_KEYS
from unit.peer.members_made import card_for as made_card

ADA = "user:ada"
YEAR = datetime.timedelta(days=365)


@pytest.mark.parametrize(
    ("who", "name"),
    [
        ("user:ada", "user:ada"),
        ("user:ada@studio", "user:ada@studio"),
        ("node:5", "node:5"),
        ("127.0.0.2", "node:2130706434"),
        ("node:127.0.0.2", "node:2130706434"),
    ],
)
def test_users_are_named_and_nodes_by_id_or_address(who: str, name: str) -> None:
    assert member_name(who) == name


@pytest.mark.parametrize(
    "who",
    [
        "",
        "ada",
        "user:",
        "user:a/b",
        "user:" + "x" * 51,
        "node:x",
        "node:05",
        "node:0.0.0.0",
        "node:node:127.0.0.2",
        "user:127.0.0.2 ",
        "0.0.0.0",
        "user:ada\n",
        "USER:ada",
    ],
)
def test_what_names_nobody_is_refused(who: str) -> None:
    with pytest.raises(UsageFault, match="names no member"):
        member_name(who)


def test_roles_have_names() -> None:
    assert [role_named(name) for name in ("reader", "writer", "owner")] == list(Role)
    with pytest.raises(UsageFault, match="there is no role"):
        role_named("boss")


async def believed(who: str, certificate: bytes, view: LogView, folder: Path) -> Card:
    """The card in a file, where the cluster's log is so far."""
    file, nodes = folder / "sent.pem", Nodes(NOW + YEAR, {})
    file.write_bytes(certificate)
    its = membership(nodes, folder, [], view)
    cluster = SimpleNamespace(calls=nodes, profile=its._profile, membership=its, log=Log(view), in_worker=nodes.world.workers.run)
    return await card_for(cluster, who, file)  # type: ignore[arg-type]


def renewed(name: str, who: int) -> bytes:
    """What the authority gives to who sends it an old certificate, be the keys revoked or not."""
    return made_card(name, who, since=YEAR / 2).der


async def test_a_certificate_that_was_renewed_by_file_is_the_members(tmp_path: Path) -> None:
    for name, view in ((ADA, enrolled_as(made_card(ADA, 1))), (NODE, LogView(nodes={OTHER: keys_of(1)}))):
        assert (await believed(name, renewed(name, 1), view, tmp_path)).der == renewed(name, 1)


async def test_a_certificate_of_another_authority_is_not_believed(tmp_path: Path) -> None:
    foreign = Authority.create("studio", now=NOW).certify(ADA, [], TLS_KEYS[1], keys=NEWCOMERS[1].public(), now=NOW + YEAR / 2)
    with pytest.raises(DamagedData):
        await believed(ADA, foreign, enrolled_as(made_card(ADA, 1)), tmp_path)


@pytest.mark.parametrize("name, view", [(ADA, enrolled_as(made_card(ADA, 1))), (NODE, LogView(nodes={OTHER: keys_of(1)}))])
async def test_a_revoked_key_is_not_believed_in_a_new_certificate(name: str, view: LogView, tmp_path: Path) -> None:
    """Neither while nobody has the name, nor when somebody has it again, under other keys."""
    revoked = view.roll.without(name, keys_of(1).signing_id)
    again = {**revoked.cards, name: made_card(name, 0)}
    for roll in (revoked, Roll(cards=again, revoked=revoked.revoked)):
        with pytest.raises(LocalFault, match="is revoked"):
            await believed(name, renewed(name, 1), LogView(nodes=view.nodes, roll=roll), tmp_path)


async def test_keys_that_are_not_the_members_present_ones_are_not_believed(tmp_path: Path) -> None:
    for name, view in ((ADA, enrolled_as(made_card(ADA, 0))), (NODE, LogView(nodes={OTHER: keys_of(0)}))):
        with pytest.raises(LocalFault, match="not the keys by which"):
            await believed(name, renewed(name, 1), view, tmp_path)
    mixed = MemberKeys(NEWCOMERS[0].public().signing, NEWCOMERS[1].public().sealing)
    certificate = AUTHORITY.certify(ADA, [], TLS_KEYS[0], keys=mixed, now=NOW + YEAR / 2)
    with pytest.raises(LocalFault, match="not the keys by which"):
        await believed(ADA, certificate, enrolled_as(made_card(ADA, 0)), tmp_path)


async def test_who_never_came_is_no_member_whatever_the_authority_issued(tmp_path: Path) -> None:
    with pytest.raises(LocalFault, match="no member of studio"):
        await believed(ADA, renewed(ADA, 1), LogView(), tmp_path)
