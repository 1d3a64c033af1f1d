"""If this fails, a node whose key was revoked stays on the line, or what was done of a revocation is not told."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from scenefold.base.errors import LocalFault, Refused, Unreachable
from scenefold.base.ids import NodeId
from scenefold.client.membership import Revoked
from scenefold.wire import Member, Packet, RemoveNode, RevokeNode
from scenefold.wire.enrol_packets import Administer
from scenefold.world.log_view import LogView
from scenefold.world.roll import Roll
from unit.client.test_membership import OTHER, SECOND_LIFE, VOTER, Nodes, keys_of, membership, on_line, ordered_by
from unit.peer.members_made import NOW, card_for


@pytest.mark.parametrize(
    "registered, expected",
    [({OTHER: SECOND_LIFE}, [Member(OTHER, SECOND_LIFE)]), ({}, [Member(OTHER, bytes(16))])],
    ids=["came", "a founder that never came"],
)
async def test_who_is_revoked_leaves_the_line_as_the_log_has_it_whatever_a_table_says(
    registered: dict[NodeId, bytes], expected: list[Member], tmp_path: Path
) -> None:
    """A table is what one node says, and it may name an incarnation of before, or leave the node out: here nobody is asked for one."""
    nodes, view = Nodes(NOW, {}), replace(on_line(VOTER, OTHER), registered=registered, position=1)
    assert await membership(nodes, tmp_path, [], view).revoke_node(OTHER) == Revoked(keys=True, line=True)
    revoked, *removed = ordered_by(nodes)
    assert revoked == RevokeNode(OTHER, keys_of(1).signing_id)
    assert [entry.member for entry in removed] == expected
    assert {type(packet) for packet in nodes.asked} == {Administer}


async def test_who_stands_on_no_line_is_revoked_and_that_is_all(tmp_path: Path) -> None:
    nodes = Nodes(NOW, {})
    await membership(nodes, tmp_path, [], replace(on_line(VOTER), position=1)).revoke_node(OTHER)
    assert ordered_by(nodes) == [RevokeNode(OTHER, keys_of(1).signing_id)]


async def test_by_a_log_of_before_nobody_is_taken_off_the_line(tmp_path: Path) -> None:
    nodes = Nodes(NOW, {})
    with pytest.raises(Refused, match="may stand on the line still"):
        await membership(nodes, tmp_path, [], on_line(VOTER, OTHER)).revoke_node(OTHER)
    assert ordered_by(nodes) == [RevokeNode(OTHER, keys_of(1).signing_id)]


async def test_a_revocation_that_stopped_half_way_goes_on_where_it_stopped(tmp_path: Path) -> None:
    nodes = Nodes(NOW, {})
    done = await membership(nodes, tmp_path, [], on_line(VOTER, OTHER, revoked=(OTHER,))).revoke_node(OTHER)
    assert [(type(entry), entry.member) for entry in ordered_by(nodes)] == [(RemoveNode, Member(OTHER, SECOND_LIFE))]
    assert done == Revoked(keys=False, line=True)


async def test_what_was_revoked_wholly_may_be_revoked_again(tmp_path: Path) -> None:
    nodes, nothing = Nodes(NOW, {}), Revoked(keys=False, line=False)
    ada = card_for("user:ada", 0)
    users = LogView(roll=Roll(cards={ada.name: ada}, revoked=frozenset({(ada.name, ada.signing_id)})))
    assert await membership(nodes, tmp_path, [], on_line(VOTER, revoked=(OTHER,))).revoke_node(OTHER) == nothing
    assert await membership(nodes, tmp_path, [], users).revoke_user("ada") == nothing
    assert ordered_by(nodes) == []


async def test_nobody_is_revoked_who_never_was_a_member(tmp_path: Path) -> None:
    nodes = Nodes(NOW, {})
    with pytest.raises(LocalFault, match="no node of this cluster"):
        await membership(nodes, tmp_path, [], LogView()).revoke_node(OTHER)
    with pytest.raises(LocalFault, match="no member"):
        await membership(nodes, tmp_path, [], LogView()).revoke_user("ada")
    assert ordered_by(nodes) == []


async def test_if_the_second_order_fails_it_is_told_that_the_first_was_carried_out(tmp_path: Path) -> None:
    class Failing(Nodes):
        async def ask(self, address: str, packet: Packet, answer: object, **options: object) -> Packet:
            if ordered_by(self):
                raise Unreachable("the node does not answer")
            return await super().ask(address, packet, answer, **options)

    with pytest.raises(
        Unreachable, match=r"count no longer, but .* may stand on the line still: .*the node does not answer.*revoke it again"
    ):
        await membership(Failing(NOW, {}), tmp_path, [], replace(on_line(VOTER, OTHER), position=1)).revoke_node(OTHER)
