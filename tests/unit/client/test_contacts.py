"""If this fails, a cluster cannot be reached while the node with which it began is away, or is looked for at addresses that nobody vouches for."""

from __future__ import annotations

from pathlib import Path

import pytest

from loopback import addresses, free_ports
from scenefold.base.ids import address_of, node_id_of
from scenefold.client.contacts import CONTACTS_MAX, contacts, named_in_a_token
from scenefold.wire import LogEntry, RevokeNode
from scenefold.wire.enrol_entries import Trust
from scenefold.world.log_view import LogView
from scenefold.world.profile import ClusterProfile
from unit.peer.logs_made import add, found, key_of, node, remove
from unit.world.test_log_view import records

FIRST = address_of(node(0))


@pytest.fixture
def profile(tmp_path: Path) -> ClusterProfile:
    """It names nobody but the first node."""
    return ClusterProfile.create(tmp_path / "profile", "trial", [FIRST], ports=free_ports(addresses(1)))


def view_of(*entries: LogEntry) -> LogView:
    return LogView().after(records((found(1), add(0), *entries)), None)[0]


def joined(count: int) -> list[LogEntry]:
    return [add(index, 0) for index in range(1, 1 + count)]


def trusted(number: int) -> Trust:
    return Trust(node(number), True, view_of(*joined(number)).nodes[node(number)].sealing)


def test_nobody_but_the_founder_is_known_to_a_profile_that_never_met_another(profile: ClusterProfile) -> None:
    assert contacts(profile, LogView()) == []
    assert named_in_a_token(profile, LogView()) == [node_id_of(FIRST)]


def test_who_joined_is_asked_as_well_and_who_is_trusted_first(profile: ClusterProfile) -> None:
    view = view_of(*joined(3), trusted(3))
    assert contacts(profile, view) == [(node(number), address_of(node(number))) for number in (3, 1, 2)]
    assert named_in_a_token(profile, view) == [node(0), node(3), node(1)]


def test_who_was_removed_or_whose_key_was_revoked_is_not_asked(profile: ClusterProfile) -> None:
    view = view_of(*joined(3), remove(1), RevokeNode(node(2), key_of(2).public.key_id))
    assert [one for one, _ in contacts(profile, view)] == [node(3)]


def test_a_token_names_a_first_node_that_was_removed_last(profile: ClusterProfile) -> None:
    entries = (found(2, voters=(1,)), add(0), add(1), add(2, 1), remove(0))
    view, _ = LogView().after(records(entries), None)
    assert named_in_a_token(profile, view) == [node(1), node(2), node(0)]


def test_who_has_no_network_is_told_so_soon_however_many_nodes_there_are(profile: ClusterProfile) -> None:
    assert len(contacts(profile, view_of(*joined(CONTACTS_MAX + 9)))) == CONTACTS_MAX
