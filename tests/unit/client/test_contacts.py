"""If this fails, a cluster cannot be reached while the node with which it began is away, or is looked for at addresses that nobody vouches for."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import trio
from trio.testing import MockClock

from loopback import addresses, free_ports
from scenefold.base.errors import NotReached, Unreachable
from scenefold.base.ids import address_of, node_id_of
from scenefold.base.limits import CLIENT_CONTACT_NEXT_S, CLIENT_CONTACT_S
from scenefold.client.cluster import Cluster
from scenefold.client.contacts import CONTACTS_MAX, contacts, named_in_a_token
from scenefold.wire import ListScenes, LogEntry, Packet, RevokeNode, ScenesListed
from scenefold.wire.enrol_entries import Trust
from scenefold.world import Priority
from scenefold.world.log_view import LogView
from scenefold.world.profile import ClusterProfile
from unit.client.fake_nodes import FakeNodes, make_world
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


@pytest.mark.parametrize("count", [1, 3, CONTACTS_MAX + 2])
def test_who_was_named_as_a_seed_is_asked_however_many_others_there_are(profile: ClusterProfile, count: int) -> None:
    """For that is what somebody does to whom nobody answers."""
    seeds = [node(100 + number) for number in range(count)]
    profile = replace(profile, seeds=(FIRST, *map(address_of, seeds)))
    found = [one for one, _ in contacts(profile, view_of(*joined(CONTACTS_MAX + 9)))]
    assert found[:count] == seeds and len(found) == max(CONTACTS_MAX, count)


def test_who_was_removed_or_whose_key_was_revoked_is_not_asked(profile: ClusterProfile) -> None:
    view = view_of(*joined(3), remove(1), RevokeNode(node(2), key_of(2).public.key_id))
    assert [one for one, _ in contacts(profile, view)] == [node(3)]


def test_a_token_names_a_first_node_that_was_removed_last(profile: ClusterProfile) -> None:
    entries = (found(2, voters=(1,)), add(0), add(1), add(2, 1), remove(0))
    view, _ = LogView().after(records(entries), None)
    assert named_in_a_token(profile, view) == [node(1), node(2), node(0)]


CONNECT_S = 10.0


class Dropping(FakeNodes):
    """What is sent to nodes that are away is dropped, so that connecting to them takes its time."""

    async def request(self, address: str, priority: Priority, packet: Packet, timeout: float) -> Packet:
        if address in self.away:
            self.asked.append((address, packet))
            await trio.sleep(min(CONNECT_S, timeout))
            raise NotReached("no connection to the node: timed out", where=address)
        return await super().request(address, priority, packet, timeout)

    def cluster(self, profile: ClusterProfile, view: LogView) -> Cluster:
        """As a client of theirs that has just begun."""
        links: Any = self
        return Cluster(profile, make_world(), links, profile.user_secrets(), (view, ()))

    def check_again(self) -> None:
        """Nobody's connection is looked at."""


@pytest.mark.parametrize("known", [0, 2, CONTACTS_MAX, CONTACTS_MAX + 9])
@pytest.mark.parametrize("refresh", [True, False])
async def test_who_has_no_network_is_told_so_soon_however_many_nodes_there_are(
    autojump_clock: MockClock, profile: ClusterProfile, known: int, refresh: bool
) -> None:
    """Whatever it asks for, and again the next time."""
    view = view_of(*joined(known)) if known else LogView()
    assert len(contacts(profile, view)) == min(known, CONTACTS_MAX)
    everybody = tuple(address_of(node(number)) for number in range(1 + known))
    nodes = Dropping(everybody, away=set(everybody))
    calls = nodes.cluster(profile, view).calls

    async def ask_the_first() -> ScenesListed:
        return await calls.patiently(lambda: calls.ask(FIRST, ListScenes(0), ScenesListed))

    for _ in range(2):
        began = trio.current_time()
        with pytest.raises(Unreachable, match=r"no node of the cluster answers: timed out .*scenectl node run"):
            await (ask_the_first() if refresh else calls.ask_any(ListScenes(0), ScenesListed))
        assert trio.current_time() - began <= CLIENT_CONTACT_S
    assert len({address for address, _ in nodes.asked}) == 1 + min(known, CONTACTS_MAX), "all of them were asked"


async def test_the_last_that_is_there_answers_soon_while_all_others_still_try(autojump_clock: MockClock, profile: ClusterProfile) -> None:
    everybody = tuple(address_of(node(number)) for number in range(1 + CONTACTS_MAX))
    for ask in ("any", "opinions"):
        nodes = Dropping(everybody, away=set(everybody[:-1]))
        calls, began = nodes.cluster(profile, view_of(*joined(CONTACTS_MAX))).calls, trio.current_time()
        if ask == "any":
            await calls.ask_any(ListScenes(0), ScenesListed)
        else:
            await calls.opinions(ListScenes(0), ScenesListed, id)
        assert trio.current_time() - began <= CONTACTS_MAX * CLIENT_CONTACT_NEXT_S + 1.0


async def test_once_somebody_has_answered_each_request_has_its_own_time(autojump_clock: MockClock, profile: ClusterProfile) -> None:
    nodes = Dropping((FIRST,))
    calls = nodes.cluster(profile, LogView()).calls

    async def slow() -> float:
        await calls.ask(FIRST, ListScenes(0), ScenesListed)
        await trio.sleep(2 * CLIENT_CONTACT_S)
        return trio.current_time()

    assert await calls.patiently(slow) >= 2 * CLIENT_CONTACT_S


class Frozen(Dropping):
    """Nodes that are away take connections and say nothing; at the address of the last one nothing runs."""

    async def request(self, address: str, priority: Priority, packet: Packet, timeout: float) -> Packet:
        if address == address_of(node(2)):
            raise NotReached("no connection to the node: Connection refused", where=address)
        await trio.sleep_forever()
        raise AssertionError


@pytest.mark.parametrize("refresh", [True, False])
async def test_who_says_nothing_is_not_called_refused_as_another_is(
    autojump_clock: MockClock, profile: ClusterProfile, refresh: bool
) -> None:
    calls = Frozen((FIRST,)).cluster(profile, view_of(*joined(2))).calls

    async def ask_the_first() -> ScenesListed:
        return await calls.patiently(lambda: calls.ask(FIRST, ListScenes(0), ScenesListed))

    with pytest.raises(Unreachable) as silence:
        await (ask_the_first() if refresh else calls.ask_any(ListScenes(0), ScenesListed))
    assert silence.value.what == "no node of the cluster answers"
    groups = dict(reversed(group.split(": ")) for group in silence.value.where.split("; "))
    assert groups["Connection refused"] == address_of(node(2))
    assert set(groups["no answer in time"].split(", ")) == {FIRST, address_of(node(1))}
